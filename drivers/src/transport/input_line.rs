//! An input of a serial line that another device switches: a chest belt's, or that of an ECG. Its
//! edges are stamped by the host.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serialport::{SerialPort as _, TTYPort};

use sonoweave_core::clock::Clock;

use super::LineError;
use super::serial::{named, refusal};

/// Time between two looks at the input. An edge is stamped later by half of it, on average: breaths
/// and heart beats take a thousand times as long.
const LOOK: Duration = Duration::from_millis(1);
/// Rate of the port, which no data use.
const BAUD: u32 = 9600;

/// The input of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// Clear to send.
    ClearToSend,
    /// Data carrier detect.
    CarrierDetect,
}

/// An edge of the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// From off to on.
    Rising,
    /// From on to off.
    Falling,
}

/// An input that is watched.
#[derive(Debug)]
pub struct InputLine {
    port: TTYPort,
    input: Input,
}

/// Reads whether an input is on.
trait Level {
    /// # Errors
    /// A sentence when it cannot be read.
    fn is_on(&mut self) -> Result<bool, LineError>;
}

impl Level for InputLine {
    fn is_on(&mut self) -> Result<bool, LineError> {
        let read = match self.input {
            Input::ClearToSend => self.port.read_clear_to_send(),
            Input::CarrierDetect => self.port.read_carrier_detect(),
        };
        read.map_err(|error| LineError::Failed(format!("has no inputs that can be read: {error}; give another port")))
    }
}

impl InputLine {
    /// Opens the port.
    ///
    /// # Errors
    /// [`LineError`] when it cannot be opened, or has no such input.
    pub fn open(path: &Path, input: Input) -> Result<Self, LineError> {
        let port = named(path, BAUD).open_native().map_err(|error| refusal(path, &error))?;
        let mut line = Self { port, input };
        line.is_on()?;
        Ok(line)
    }

    /// Calls `marked` with the host time, ns, of each edge, until `ends` is set.
    ///
    /// # Errors
    /// [`LineError`] when the input can no longer be read.
    pub fn watch(
        &mut self,
        edge: Edge,
        clock: &dyn Clock,
        ends: &AtomicBool,
        marked: impl FnMut(i64),
    ) -> Result<(), LineError> {
        watch(self, edge, clock, || ends.load(Ordering::Relaxed), || std::thread::sleep(LOOK), marked)
    }
}

/// Watches an input until `ends` returns true, with `rest` between two looks.
fn watch(
    level: &mut impl Level,
    edge: Edge,
    clock: &dyn Clock,
    ends: impl Fn() -> bool,
    rest: impl Fn(),
    mut marked: impl FnMut(i64),
) -> Result<(), LineError> {
    let mut was_on = level.is_on()?;
    while !ends() {
        rest();
        let is_on = level.is_on()?;
        let is_edge = match edge {
            Edge::Rising => !was_on && is_on,
            Edge::Falling => was_on && !is_on,
        };
        if is_edge {
            marked(clock.now_ns());
        }
        was_on = is_on;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use sonoweave_core::clock::{MS, Manual};

    use super::*;

    /// An input that is on from 1 s to 1.2 s of each 4 s, and is unplugged at a time.
    struct Belt<'a> {
        clock: &'a Manual,
        until_ns: i64,
    }

    impl Level for Belt<'_> {
        fn is_on(&mut self) -> Result<bool, LineError> {
            let now_ns = self.clock.now_ns();
            if now_ns >= self.until_ns {
                return Err(LineError::Failed("unplugged".into()));
            }
            Ok((1000..1200).contains(&(now_ns / MS % 4000)))
        }
    }

    /// Returns the marked times, ms, of 10 s.
    fn marked(edge: Edge, until_ms: i64) -> (Vec<i64>, Result<(), LineError>) {
        let clock = Manual::at(0);
        let mut found = Vec::new();
        let looks = Cell::new(0);
        let rest = || {
            looks.set(looks.get() + 1);
            clock.pass(MS);
        };
        let ends = || clock.now_ns() >= 10_000 * MS;
        let mut belt = Belt { clock: &clock, until_ns: until_ms * MS };
        let result = watch(&mut belt, edge, &clock, ends, rest, |at_ns| found.push(at_ns / MS));
        assert!(looks.get() <= 10_000);
        (found, result)
    }

    #[test]
    fn edges_are_stamped_once_each() {
        assert_eq!(marked(Edge::Rising, i64::MAX / MS), (vec![1000, 5000, 9000], Ok(())));
        assert_eq!(marked(Edge::Falling, i64::MAX / MS), (vec![1200, 5200, 9200], Ok(())));
        let (before, result) = marked(Edge::Rising, 6000);
        assert_eq!(before, [1000, 5000]);
        assert!(matches!(result, Err(LineError::Failed(why)) if why == "unplugged"));
    }

    #[test]
    fn port_without_inputs_is_refused_with_its_name() {
        let absent = InputLine::open(Path::new("/dev/ttyNONE"), Input::ClearToSend).unwrap_err();
        assert!(matches!(absent, LineError::Absent(_)), "{absent:?}");
        // A pseudo-terminal has no inputs.
        let (master, slave) = TTYPort::pair().unwrap();
        let path = std::path::PathBuf::from(slave.name().unwrap());
        drop(slave);
        let refused = InputLine::open(&path, Input::CarrierDetect).unwrap_err().to_string();
        assert!(refused.starts_with("has no inputs that can be read"), "{refused}");
        drop(master);
    }
}
