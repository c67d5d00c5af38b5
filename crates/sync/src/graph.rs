//! The chain of named transforms from the image to the world.
//!
//! Frames are nodes; transforms are edges that can be used in both directions. Only names
//! matter here: whether a transform is valid in a given frame never changes the chain. A
//! dropout thus leads to a refusal and never silently to another geometry.

use std::collections::{BTreeMap, BTreeSet};

/// World frames in the order of preference, if none is configured.
pub(super) const WORLDS: [&str; 3] = ["Reference", "Tracker", "World"];

/// One transform of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// The transform.
    pub edge: Edge,
    /// Whether it is used from its `to` to its `from`, as its inverse.
    pub inverted: bool,
}

/// A transform by its index in the lists given to [`find`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// Delivered with every frame by the source.
    PerFrame(usize),
    /// Constant, from the configuration.
    Static(usize),
}

/// A chain of transforms through named frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Route {
    /// The transforms, starting at the image.
    pub steps: Vec<Step>,
    /// The frames along the chain, from the image to the world, both included.
    pub frames: Vec<String>,
}

impl Route {
    /// Name of the last frame.
    pub fn world(&self) -> &str {
        self.frames.last().map_or("", String::as_str)
    }

    /// Human-readable form: `Image → Probe → Tracker → Reference`.
    pub fn describe(&self) -> String {
        self.frames.join(" → ")
    }
}

/// A frame name pair, `from` and `to`.
pub type Names = (String, String);

/// Whether a name is of a frame of pixels, whose transforms may have scale and skew: the image's,
/// or `CroppedImage`, `TransducerOriginPixel`, ….
pub(crate) fn is_image_frame(image: &str, name: &str) -> bool {
    name == image || name.ends_with("Image") || name.ends_with("Pixel")
}

/// Finds the shortest chain from `start` to `goal`. Among equally short ones it prefers the
/// fewest constant transforms, then the first by the names of the frames passed; a transform
/// used forwards precedes one used backwards. The result does not depend on the order of the
/// lists, unless they repeat a pair of names.
pub fn find(per_frame: &[Names], statics: &[Names], start: &str, goal: &str) -> Option<Route> {
    // Neighbours by name; only the best of parallel edges is kept, so that ties are settled
    // here once.
    let mut neighbours: BTreeMap<&str, BTreeMap<&str, Step>> = BTreeMap::new();
    let edges = |list: &'_ [Names], make: fn(usize) -> Edge| (0..list.len()).map(make).collect::<Vec<_>>();
    let all = edges(per_frame, Edge::PerFrame).into_iter().chain(edges(statics, Edge::Static));
    for edge in all {
        let (from, to) = match edge {
            Edge::PerFrame(index) => &per_frame[index],
            Edge::Static(index) => &statics[index],
        };
        for (here, there, inverted) in [(from, to, false), (to, from, true)] {
            let step = Step { edge, inverted };
            let known = neighbours.entry(here).or_default().entry(there).or_insert(step);
            if preference(&step) < preference(known) {
                *known = step;
            }
        }
    }

    // Breadth-first search, one layer at a time; each layer keeps the best chain to each frame
    // by the rules above.
    let mut layer: BTreeMap<&str, Way<'_>> = BTreeMap::from([(start, Way::default())]);
    let mut seen = BTreeSet::from([start]);
    while !layer.is_empty() {
        if let Some(way) = layer.get(goal) {
            let frames = std::iter::once(start).chain(way.names.iter().copied()).map(str::to_owned).collect();
            return Some(Route { steps: way.steps.clone(), frames });
        }
        let mut next: BTreeMap<&str, Way<'_>> = BTreeMap::new();
        for (here, way) in &layer {
            for (there, step) in neighbours.get(here).into_iter().flatten() {
                if seen.contains(there) {
                    continue;
                }
                let longer = way.with(there, *step);
                match next.get(there) {
                    Some(known) if (known.statics, &known.names) <= (longer.statics, &longer.names) => {}
                    _ => {
                        next.insert(there, longer);
                    }
                }
            }
        }
        seen.extend(next.keys());
        layer = next;
    }
    None
}

fn preference(step: &Step) -> (bool, bool) {
    (matches!(step.edge, Edge::Static(_)), step.inverted)
}

#[derive(Clone, Default)]
struct Way<'a> {
    statics: usize,
    names: Vec<&'a str>,
    steps: Vec<Step>,
}

impl<'a> Way<'a> {
    fn with(&self, name: &'a str, step: Step) -> Self {
        let mut longer = self.clone();
        longer.statics += usize::from(matches!(step.edge, Edge::Static(_)));
        longer.names.push(name);
        longer.steps.push(step);
        longer
    }
}

/// No chain leads from the image to the world.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "no way from {image} to {world}: the sequence holds {}, the configuration holds {}; {}",
    listed(.sequence), listed(.configuration), self.advice()
)]
pub struct NoPath {
    /// Name of the image frame.
    pub image: String,
    /// Name of the wanted world frame, or of those that would do.
    pub world: String,
    /// Names of the recording's transforms.
    pub sequence: Vec<String>,
    /// Names of the configuration's transforms.
    pub configuration: Vec<String>,
}

impl NoPath {
    fn advice(&self) -> String {
        let image = &self.image;
        let starts = |name: &String| name.starts_with(&format!("{image}To")) || name.ends_with(&format!("To{image}"));
        if self.sequence.is_empty() {
            return "a sequence without transforms cannot be placed in space; is it the right file?".into();
        }
        if self.sequence.iter().chain(&self.configuration).any(starts) {
            return "name a world that the transforms reach, or give the missing transform in the configuration".into();
        }
        // A calibration must end at a frame that the sequence tracks.
        let tracked = |name: &str| self.sequence.iter().any(|t| t.starts_with(&format!("{name}To")));
        if tracked("Probe") {
            format!("give a configuration with {image}ToProbe")
        } else {
            format!("the calibration in the configuration must lead from {image} to a frame that the sequence tracks")
        }
    }
}

/// Largest number of names listed.
const LISTED: usize = 12;

fn listed(names: &[String]) -> String {
    match names.len() {
        0 => "no transform".into(),
        n if n > LISTED => format!("{} and {} more", names[..LISTED].join(", "), n - LISTED),
        _ => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn names(pairs: &[(&str, &str)]) -> Vec<Names> {
        pairs.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())).collect()
    }

    fn way(per_frame: &[(&str, &str)], statics: &[(&str, &str)], goal: &str) -> Option<(String, Vec<Step>)> {
        find(&names(per_frame), &names(statics), "Image", goal).map(|route| (route.describe(), route.steps))
    }

    #[test]
    fn transforms_used_in_both_directions() {
        let tracked = [("Probe", "Tracker"), ("Reference", "Tracker"), ("Stylus", "Tracker")];
        let (path, steps) = way(&tracked, &[("Image", "Probe")], "Reference").unwrap();
        assert_eq!(path, "Image → Probe → Tracker → Reference");
        let expected = [(Edge::Static(0), false), (Edge::PerFrame(0), false), (Edge::PerFrame(1), true)];
        assert_eq!(steps, expected.map(|(edge, inverted)| Step { edge, inverted }));
        let (_, steps) = way(&[("Tracker", "Probe")], &[("Probe", "Image")], "Tracker").unwrap();
        assert!(steps.iter().all(|step| step.inverted));
    }

    #[test]
    fn shortest_chain_wins_then_per_frame_then_names() {
        let (path, _) =
            way(&[("Image", "Reference"), ("Probe", "Reference")], &[("Image", "Probe")], "Reference").unwrap();
        assert_eq!(path, "Image → Reference");
        let (_, steps) = way(&[("Probe", "Image"), ("Probe", "Tracker")], &[("Image", "Probe")], "Tracker").unwrap();
        assert_eq!(steps[0], Step { edge: Edge::PerFrame(0), inverted: true });
        let (path, _) = way(&[("Image", "B"), ("B", "World")], &[("Image", "A"), ("A", "World")], "World").unwrap();
        assert_eq!(path, "Image → B → World");
        let (path, _) = way(&[("Image", "B"), ("B", "World"), ("Image", "A"), ("A", "World")], &[], "World").unwrap();
        assert_eq!(path, "Image → A → World");
    }

    #[test]
    fn no_path_error_lists_names_and_advice() {
        assert_eq!(way(&[("Probe", "Tracker")], &[("Image", "Transducer")], "Tracker"), None);
        let error = |sequence: &[&str], configuration: &[&str]| {
            let own = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect();
            let (sequence, configuration) = (own(sequence), own(configuration));
            NoPath { image: "Image".into(), world: "Reference".into(), sequence, configuration }.to_string()
        };
        assert_eq!(
            error(&["ProbeToTracker", "ReferenceToTracker"], &[]),
            "no way from Image to Reference: the sequence holds ProbeToTracker, ReferenceToTracker, the configuration holds no \
             transform; give a configuration with ImageToProbe"
        );
        assert!(error(&["ToolToTracker"], &[]).ends_with("to a frame that the sequence tracks"));
        assert!(error(&["ProbeToTracker"], &["ImageToProbe"]).contains("name a world"));
        assert!(error(&[], &["ImageToProbe"]).contains("cannot be placed in space"));
        let many: Vec<String> = (0..40).map(|i| format!("T{i}ToTracker")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert!(error(&many, &[]).contains("and 28 more"));
    }

    proptest! {
        #[test]
        fn chain_independent_of_list_order(
            edges in prop::collection::btree_set((0_u8..6, 0_u8..6), 1..12), split in 0_usize..12, turn in 0_usize..12,
        ) {
            let all: Vec<Names> = edges
                .iter()
                .filter(|(a, b)| a != b)
                .map(|(a, b)| (format!("F{a}"), format!("F{b}")))
                .collect();
            let (per_frame, statics) = all.split_at(split.min(all.len()));
            let mut turned = per_frame.to_vec();
            if !turned.is_empty() {
                let by = turn % turned.len();
                turned.rotate_left(by);
            }
            let one = find(per_frame, statics, "F0", "F5");
            let two = find(&turned, statics, "F0", "F5");
            prop_assert_eq!(one.as_ref().map(|r| &r.frames), two.as_ref().map(|r| &r.frames));
            // Each step leads from one frame of the chain to the next.
            if let Some(route) = one {
                for (step, pair) in route.steps.iter().zip(route.frames.windows(2)) {
                    let (from, to) = match step.edge {
                        Edge::PerFrame(i) => &per_frame[i],
                        Edge::Static(i) => &statics[i],
                    };
                    let walked = if step.inverted { (to, from) } else { (from, to) };
                    prop_assert_eq!(walked, (&pair[0], &pair[1]));
                }
            }
        }
    }
}
