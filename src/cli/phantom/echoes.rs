//! Flags of `phantom` for bodies, which a simulated scanner images.

use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3};

use calibration::phantom::file::{PhantomFile, Registration};
use calibration::phantom::{Geometry, Landmark, Wire};
use phantom::bmode::{Effects, Transducer};
use phantom::named::{ProbeName, SceneContent, SceneName, SceneOptions};
use phantom::{Scan, body};
use sonoweave_core::frames::Transform;

use crate::cli::Failure;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum EffectName {
    /// Echoes of scatterers
    Speckle,
    /// Echoes of surfaces
    Surfaces,
    /// Attenuation by materials and surfaces: without it there is no shadow
    Attenuation,
    /// Repeated echoes
    Reverberation,
    /// Ringing of the transducer at its face
    Ringing,
    /// Widening of the beams away from their focus
    Focusing,
    /// Amplification with depth
    Tgc,
    /// Noise of the receiver
    Noise,
}

/// Settings of the scanner; each has a default that suits the scene.
#[derive(Debug, Args)]
#[command(next_help_heading = "Scanner, for --scene doll, thigh, n-wire, cross-wire, tank-floor and stylus")]
pub(super) struct EchoFlags {
    /// Transducer [default: suits the scene]
    #[arg(long, value_enum, value_name = "PROBE")]
    probe: Option<ProbeName>,
    /// Depth of the field, mm
    #[arg(long, value_name = "MM")]
    depth: Option<f64>,
    /// Centre frequency, MHz
    #[arg(long, value_name = "MHZ")]
    mhz: Option<f64>,
    /// Depth of the focus within the slice, mm
    #[arg(long, value_name = "MM")]
    focus: Option<f64>,
    /// Amplification with depth, dB/cm
    #[arg(long, value_name = "DB")]
    tgc: Option<f64>,
    /// Range from white to black, dB
    #[arg(long, value_name = "DB")]
    dynamic_range: Option<f64>,
    /// Leave out effects of the scanner, e.g. noise,reverberation
    #[arg(long, value_enum, value_name = "EFFECT", value_delimiter = ',')]
    without: Vec<EffectName>,
}

impl EchoFlags {
    /// Whether any was given.
    pub(super) fn given(&self) -> bool {
        let numbers = [self.depth, self.mhz, self.focus, self.tgc, self.dynamic_range];
        self.probe.is_some() || !self.without.is_empty() || numbers.iter().any(Option::is_some)
    }

    /// Returns the contents of the images of a scene; for echoes, with the scanner of these
    /// flags.
    pub(super) fn content(&self, scene: SceneName, options: SceneOptions) -> SceneContent {
        let mut shown = scene.content(&SceneOptions { probe: self.probe, depth_mm: self.depth, ..options });
        let SceneContent::Echoes(scanned) = &mut shown else { return shown };
        let scanner = &mut scanned.scanner;
        for (to, from) in [
            (&mut scanner.frequency_mhz, self.mhz),
            (&mut scanner.lateral.focus_mm, self.focus),
            (&mut scanner.tgc_db_per_cm, self.tgc),
            (&mut scanner.dynamic_range_db, self.dynamic_range),
        ] {
            *to = from.unwrap_or(*to);
        }
        let has = |effect| !self.without.contains(&effect);
        scanner.effects = Effects {
            speckle: has(EffectName::Speckle),
            surfaces: has(EffectName::Surfaces),
            wires: true,
            attenuation: has(EffectName::Attenuation),
            losses: has(EffectName::Attenuation),
            reverberation: has(EffectName::Reverberation),
            ringing: has(EffectName::Ringing),
            focusing: has(EffectName::Focusing),
            tgc: has(EffectName::Tgc),
            noise: has(EffectName::Noise),
        };
        shown
    }
}

/// Describes the scanner, for people and provenance; empty without a scanner.
pub(super) fn describe(scan: &Scan) -> String {
    let Some(bmode) = scan.bmode() else { return String::new() };
    let scanner = bmode.scanner();
    let probe = match scanner.transducer {
        Transducer::Curvilinear { radius_mm, opening_deg } => {
            format!("curvilinear transducer of {radius_mm} mm radius and {opening_deg} degrees")
        }
        Transducer::Linear { width_mm } => format!("linear transducer of {width_mm} mm"),
    };
    let field = match (bmode.layout().fan(), bmode.layout().clip()) {
        (Some(fan), _) => {
            let ([u, v], [near, far], [first, last]) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
            format!("fan {u:.3},{v:.3},{near:.3},{far:.3},{first},{last}")
        }
        (None, Some(clip)) => format!("clip {},{},{},{}", clip.x, clip.y, clip.width, clip.height),
        (None, None) => "no field".into(),
    };
    format!(
        ", {probe}, {} MHz, depth {} mm, focus {} mm, dynamic range {} dB, {field}",
        scanner.frequency_mhz, scanner.depth_mm, scanner.lateral.focus_mm, scanner.dynamic_range_db
    )
}

/// Returns a scan's phantom and its pose; the world is the reference sensor. Wires of one number
/// belong together, and are listed from right to left.
///
/// # Errors
/// [`Failure`] when the scene has no calibration targets.
pub(super) fn held(scan: &Scan) -> Result<PhantomFile, Failure> {
    let within = |problem: String| Failure::usage(format!("--phantom: {problem}"));
    let Some(bmode) = scan.bmode() else {
        return Err(within("the scene is no body; choose a calibration phantom".into()));
    };
    let body = bmode.body();
    let number = |name: &str| name.trim_end_matches(char::is_alphabetic).to_owned();
    let patterns = body.wires.chunk_by(|one, other| number(&one.name) == number(&other.name)).map(|wires| {
        let wires = wires.iter().rev();
        wires.map(|wire| Wire { name: wire.name.clone(), ends_mm: [wire.from, wire.to] }).collect()
    });
    let landmark = |own: &body::Landmark| Landmark { name: own.name.into(), position_mm: own.point };
    let geometry = Geometry::new(body.name, patterns.collect(), body.landmarks.iter().map(landmark).collect());
    let registration = Registration::new(Transform::from_affine(body.world_from_body), None)
        .map_err(|error| within(error.to_string()))?;
    Ok(PhantomFile { geometry: geometry.map_err(|e| within(e.to_string()))?, registration: Some(registration) })
}

/// Returns the intersections of a scan's wires with its images: a line each, pixels of the image
/// in MF orientation. The first lines are the positions of landmarks in the world.
pub(super) fn crossings(scan: &Scan) -> String {
    let mut text = String::from("frame,name,u_px,v_px,x_mm,y_mm,z_mm\n");
    let Some(bmode) = scan.bmode() else { return text };
    let body = bmode.body();
    let mut line = |frame: Option<u32>, name: &str, at: Option<DVec2>, world: DVec3| {
        let frame = frame.map_or(String::new(), |f| f.to_string());
        let [u, v] = at.map_or([String::new(), String::new()], |p| p.to_array().map(|x| x.to_string()));
        text.push_str(&format!("{frame},{name},{u},{v},{},{},{}\n", world.x, world.y, world.z));
    };
    for landmark in &body.landmarks {
        line(None, landmark.name, None, body.world_from_body.transform_point3(landmark.point));
    }
    for frame in 0..scan.frames() {
        let world_from_image = scan.true_world_from_image(frame).affine();
        let body_from_image = body.world_from_body.inverse() * world_from_image;
        for wire in &body.wires {
            if let Some(at) = wire.crossing(&body_from_image) {
                line(Some(frame), &wire.name, Some(at), world_from_image.transform_point3(at.extend(0.0)));
            }
        }
    }
    text
}
