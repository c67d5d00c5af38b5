//! Converts rests of an arm's joints to touches of known places.

use std::path::{Path, PathBuf};

use glam::DVec2;

use calibration::arm::fit::{Known, Touch};
use calibration::arm::rest::{Rest, find};
use calibration::arm::{Arm, JOINTS, plate};

use super::options::{TouchedDivots, Which};
use super::session::{self, Recorded};
use crate::failure::Failure;

/// Largest number of rests that a refusal lists.
const LISTED: usize = 40;

/// The geometry of [`TouchedDivots`], read from its file.
pub(crate) enum Place {
    Divots(Vec<DVec2>),
    Point,
    Distances(Vec<f64>),
}

/// Touches with their places.
pub(crate) struct Touched {
    place: Place,
    pub(crate) touches: Vec<Touch>,
    /// The rest of each touch, by its number from 1.
    pub(crate) rests: Vec<(usize, Rest)>,
}

impl TouchedDivots {
    /// Returns the geometry's file, if it has one.
    pub(crate) fn file(&self) -> Option<&PathBuf> {
        self.plate.as_ref()
    }

    /// Reads the geometry.
    ///
    /// # Errors
    /// [`Failure`] for an invalid plate file.
    pub(crate) fn read(&self) -> Result<Place, Failure> {
        Ok(match &self.plate {
            Some(path) => Place::Divots(plate::read(path)?),
            None if self.point => Place::Point,
            None => Place::Distances(self.distances.clone()),
        })
    }
}

impl Which {
    /// Reads the session's counts, within the requested time.
    ///
    /// # Errors
    /// [`Failure`], as of [`session::read`].
    pub(crate) fn read(&self, session: &Path) -> Result<Recorded, Failure> {
        session::read(session, self.from, self.to)
    }

    /// Finds the touches among the counts.
    ///
    /// # Errors
    /// [`Failure`] when the joints did not rest, or the number of rests does not match the
    /// places.
    pub(crate) fn touches(
        &self,
        session: &Path,
        arm: &Arm,
        readings: &[(f64, [f64; JOINTS])],
        place: Place,
    ) -> Result<Touched, Failure> {
        let within = |problem: String| Failure::new(format!("{}: {problem}", session.display()));
        let rests = find(arm, readings, self.still, self.rest);
        if let Some(none) = self.skip.iter().find(|number| !(1..=rests.len()).contains(*number)) {
            return Err(within(format!(
                "--skip {none}: must be a rest's number, and the joints rested {} times{}",
                rests.len(),
                listed(&rests)
            )));
        }
        if rests.is_empty() {
            return Err(within(format!(
                "the joints never rested for {} s; hold the tip still for two seconds at each touch",
                self.rest
            )));
        }
        let numbered = (1..).zip(rests.iter().copied()).filter(|(number, _)| !self.skip.contains(number));
        let kept: Vec<(usize, Rest)> = numbered.collect();
        let advice = format!("; leave out by --skip the rests that were no touches{}", listed(&rests));
        let (place, of): (Place, Vec<usize>) = match place {
            Place::Point => (Place::Point, vec![0; kept.len()]),
            Place::Divots(divots) if self.order.is_empty() => {
                if !kept.len().is_multiple_of(divots.len()) {
                    return Err(within(format!(
                        "the joints rested {} times, which is no whole number of rounds over {} divots; give the divot of each touch by --order{advice}",
                        kept.len(),
                        divots.len()
                    )));
                }
                let of = (0..kept.len()).map(|touch| touch % divots.len()).collect();
                (Place::Divots(divots), of)
            }
            Place::Divots(divots) => {
                if self.order.len() != kept.len() {
                    return Err(within(format!(
                        "--order gives the divots of {} touches, but the joints rested {} times{advice}",
                        self.order.len(),
                        kept.len()
                    )));
                }
                let of = self.order.iter().map(|number| number.checked_sub(1));
                let of = of.collect::<Option<Vec<usize>>>();
                (
                    Place::Divots(divots),
                    of.ok_or_else(|| Failure::new("--order 0: give divots by their numbers, from 1"))?,
                )
            }
            Place::Distances(distances) => {
                let pairs = kept.len() / 2;
                if !kept.len().is_multiple_of(2) || ![1, pairs].contains(&distances.len()) {
                    return Err(within(format!(
                        "the joints rested {} times, but each of {} distances takes two touches{advice}",
                        kept.len(),
                        if distances.len() == 1 { pairs } else { distances.len() }
                    )));
                }
                let all = if distances.len() == 1 { vec![distances[0]; pairs] } else { distances };
                (Place::Distances(all), (0..kept.len()).map(|touch| touch / 2).collect())
            }
        };
        let touches = kept.iter().zip(of).map(|((_, rest), of)| Touch { counts: rest.counts, of }).collect();
        Ok(Touched { place, touches, rests: kept })
    }
}

impl Touched {
    /// Returns the known geometry for the fit.
    pub(crate) fn known(&self) -> Known<'_> {
        match &self.place {
            Place::Divots(divots) => Known::Divots(divots),
            Place::Point => Known::Divots(&[DVec2::ZERO]),
            Place::Distances(distances) => Known::Distances(distances),
        }
    }

    /// Describes the number of touches and places.
    pub(crate) fn words(&self) -> String {
        let touches = self.touches.len();
        match &self.place {
            Place::Divots(divots) => format!("{touches} touches of {} divots", divots.len()),
            Place::Point => format!("{touches} touches of one point"),
            Place::Distances(distances) => format!("{touches} touches, two of each of {} distances", distances.len()),
        }
    }

    /// Names a residual: a touch, or the two touches of a distance.
    pub(crate) fn name(&self, residual: usize) -> String {
        let number = |touch: usize| self.rests[touch].0;
        match &self.place {
            Place::Divots(_) => format!("touch {} of divot {}", number(residual), self.touches[residual].of + 1),
            Place::Point => format!("touch {}", number(residual)),
            Place::Distances(_) => format!("touches {} and {}", number(2 * residual), number(2 * residual + 1)),
        }
    }

    /// Returns the first and the last time of a touch or a distance, s.
    pub(crate) fn time_s(&self, residual: usize) -> [f64; 2] {
        let [first, last] = match &self.place {
            Place::Distances(_) => [2 * residual, 2 * residual + 1],
            _ => [residual; 2],
        };
        [self.rests[first].1.time_s[0], self.rests[last].1.time_s[1]]
    }
}

/// Lists the joints' rests, for the end of a refusal.
fn listed(rests: &[Rest]) -> String {
    let some = rests.iter().take(LISTED).zip(1..);
    let some: Vec<String> =
        some.map(|(rest, number)| format!("{number} at {:.1} to {:.1} s", rest.time_s[0], rest.time_s[1])).collect();
    let more = rests.len().saturating_sub(LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!(" (rests: {}{more})", some.join(", "))
}
