//! The highest picture rate: pictures that come too soon wait.
//!
//! Slices come at a rate of their own, and each picture shall begin as soon as its slice is there.
//! With a pause of one period after each picture, one that is late would delay all later ones
//! where slices come at the highest rate. The mean rate is limited instead, and a picture may
//! come up to a period earlier. That is the generic cell rate algorithm (ITU-T I.371).
//!
//! Where slices come faster, a picture that waited for its time would be late by part of the
//! slices' distance. So half a period more is granted, and who waits looks again at each slice:
//! pictures then begin with slices, and others are left out.

use std::time::{Duration, Instant};

/// The limit of the picture rate.
#[derive(Debug)]
pub(super) struct Pacing {
    /// Time at which the next picture begins at the mean rate.
    next: Instant,
    period: Duration,
}

impl Pacing {
    /// Begins; the first picture need not wait.
    pub(super) fn new(now: Instant) -> Self {
        Self { next: now, period: Duration::ZERO }
    }

    /// Returns how long the next picture has to wait.
    pub(super) fn wait(&self, now: Instant) -> Duration {
        let early = self.next.saturating_duration_since(now + self.period);
        if early <= self.period / 2 { Duration::ZERO } else { early }
    }

    /// Notes that a picture began, and the time that it takes at the highest rate.
    pub(super) fn began(&mut self, at: Instant, period: Duration) {
        self.next = self.next.max(at) + period;
        self.period = period;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(100);

    /// Returns the times at which pictures of slices begin, ms. A picture waits until it is due or
    /// another slice comes, whichever is first.
    fn pictures_of(slices_ms: &[u64]) -> Vec<u64> {
        let begun = Instant::now();
        let mut pacing = Pacing::new(begun);
        let mut pictures: Vec<u64> = Vec::new();
        for (number, &slice) in slices_ms.iter().enumerate() {
            let there = begun + Duration::from_millis(slice);
            let at = there + pacing.wait(there);
            let next = slices_ms.get(number + 1).map(|next| begun + Duration::from_millis(*next));
            if next.is_none_or(|next| at < next) {
                pacing.began(at, PERIOD);
                pictures.push(u64::try_from((at - begun).as_millis()).unwrap());
            }
        }
        pictures
    }

    #[test]
    fn late_picture_delays_no_later_one() {
        // The third slice is late by 70 ms.
        assert_eq!(pictures_of(&[0, 100, 270, 300, 400, 500]), [0, 100, 270, 300, 400, 500]);
        // All slices are early or late by some ms.
        assert_eq!(pictures_of(&[0, 93, 205, 297, 404, 499]), [0, 93, 205, 297, 404, 499]);
    }

    #[test]
    fn mean_rate_is_limited_and_pictures_begin_with_slices() {
        for distance in [10, 33, 50, 60] {
            let slices: Vec<u64> = (0..10_000 / distance).map(|n| distance * n).collect();
            let pictures = pictures_of(&slices);
            // Two of them may come early.
            assert!((100..=103).contains(&pictures.len()), "{distance}: {pictures:?}");
            let late = pictures.iter().filter(|at| !slices.contains(at)).count();
            assert!(late <= if distance < 50 { 1 } else { 20 }, "{distance}: {late} of {pictures:?}");
        }
    }

    #[test]
    fn pause_is_not_caught_up_by_more_than_two_pictures() {
        let pictures = pictures_of(&[0, 5000, 5010, 5020, 5030, 5060, 5110, 5130, 5170]);
        assert_eq!(pictures, [0, 5000, 5010, 5060, 5170]);
    }
}
