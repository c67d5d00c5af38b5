//! A virtual MicroScribe: once woken, it answers requests. Its encoders have 14 bits and count
//! from the position of the arm at power-on.

use sonoweave_core::clock::MS;
use sonoweave_core::reading::AXES;

use super::{Faults, Joints, Wire};
use crate::arm::microscribe::{BEGIN, Family, Question, Request, SIGNATURE, Sample};
use crate::transport::{LineError, Peer};

/// Time from a request to the first byte of its answer, ns.
const THINKS: i64 = 3 * MS / 10;
/// Bit mask of an encoder.
const MASK: i64 = 0x3fff;

/// State of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Session {
    /// It waits for the signature, at any rate.
    None,
    /// It has echoed the signature, at that rate.
    Signed,
    /// It obeys commands.
    Begun,
}

/// The device. Its fields are the state in which it was left.
pub struct Twin {
    joints: Joints,
    wire: Wire,
    /// The fastest rate that it detects, bits per second.
    pub fastest_baud: u32,
    /// Rate of the session, bits per second.
    pub baud: u32,
    /// State of the session.
    pub session: Session,
    /// Encoder values at home.
    pub home: [i64; AXES],
    /// Encoder values minus the positions of the joints.
    pub offsets: [i64; AXES],
    /// Maximum counts of its encoders.
    pub maxima: [u16; AXES],
    /// Pressed buttons.
    pub buttons: u8,
    /// Whether it answers the question about its links. It never answers the one about its home
    /// reference, like later firmware.
    pub answers_links: bool,
    /// Bytes obeyed so far.
    pub obeyed: Vec<u8>,
    /// Times of the samples sent, ns.
    pub sampled: Vec<i64>,
    /// It is plugged in.
    pub plugged: bool,
    /// It stays silent.
    pub hung: bool,
    input: Vec<u8>,
}

impl Twin {
    /// Creates a device that was switched on at home and has no session yet.
    pub fn new(joints: Joints, faults: Faults) -> Self {
        let home = [8192, 12_000, 14_000, 5000, 0, 16_383];
        Self {
            joints,
            wire: Wire::new(faults),
            fastest_baud: 115_200,
            baud: 9600,
            session: Session::None,
            home,
            offsets: home,
            maxima: [16_383, 16_383, 8191, 8191, 8191, 4095],
            buttons: 0,
            answers_links: true,
            obeyed: Vec::new(),
            sampled: Vec::new(),
            plugged: true,
            hung: false,
            input: Vec::new(),
        }
    }

    /// Returns its wire, for the statistics of its bytes.
    pub(super) fn wire(&self) -> &Wire {
        &self.wire
    }

    /// Replaces the faults.
    pub fn set_faults(&mut self, faults: Faults) {
        self.wire.set_faults(faults);
    }

    /// Unplugs its cable; it stays switched on.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.wire.cut();
        self.input.clear();
    }

    /// Switches it off and on: it takes the present position for home.
    pub fn switch_off_and_on(&mut self, now_ns: i64) {
        self.wire.cut();
        self.input.clear();
        self.session = Session::None;
        self.set_home(now_ns);
    }

    /// Makes a counter lose or gain steps without noticing.
    pub fn slip(&mut self, axis: usize, counts: i64) {
        self.offsets[axis] += counts;
    }

    fn set_home(&mut self, now_ns: i64) {
        let joints = (self.joints)(now_ns);
        self.offsets = std::array::from_fn(|axis| self.home[axis] - joints[axis]);
    }

    /// Returns its encoder values at a time.
    pub fn shown(&self, at_ns: i64) -> [u16; AXES] {
        let joints = (self.joints)(at_ns);
        std::array::from_fn(|axis| ((joints[axis] + self.offsets[axis]) & MASK) as u16)
    }

    fn send(&mut self, bytes: &[u8], line_baud: u32, at_ns: i64) {
        let garbled = line_baud != 0 && line_baud != self.baud;
        self.wire.send(bytes, self.baud, garbled, at_ns + THINKS);
    }

    fn answer(&self, question: Question) -> Option<Vec<u8>> {
        let text = |text: &str| [text.as_bytes(), b"\0"].concat();
        Some(match question {
            Question::Product => text("MSCR"),
            Question::Identity => text("MSCR"),
            Question::Model => text("Virtual MicroScribe"),
            Question::Serial => text("M1234"),
            Question::Comment => text("Standard"),
            Question::ParameterFormat => text("Format DH0.5"),
            Question::Version => text("HCI 2.0"),
            Question::Maxima => {
                let mut maxima = vec![0x7f, 0x3f, 0xff];
                maxima.extend([0; 9]);
                maxima.extend(self.maxima.map(u16::to_be_bytes).as_flattened());
                maxima
            }
            Question::Parameters if self.answers_links => {
                let links: [i16; 18] = std::array::from_fn(|n| n as i16 * 1000 - 3000);
                [&[36][..], links.map(i16::to_be_bytes).as_flattened()].concat()
            }
            _ => return None,
        })
    }

    fn obey(&mut self, byte: u8, line_baud: u32, now_ns: i64) {
        self.obeyed.push(byte);
        let questions = [
            Question::Parameters,
            Question::Maxima,
            Question::Product,
            Question::Identity,
            Question::Model,
            Question::Serial,
            Question::Comment,
            Question::ParameterFormat,
            Question::Version,
        ];
        match byte {
            0xc5 => self.session = Session::None,
            0xc2 => {
                self.set_home(now_ns);
                self.send(&[0xc2], line_baud, now_ns);
            }
            _ if byte < 0x80 => {
                let Some(request) = [5, 6]
                    .into_iter()
                    .filter_map(|encoders| Request::new(Family::MicroScribe, encoders, false))
                    .find(|request| request.byte() == byte)
                else {
                    return;
                };
                let mut answer = Vec::new();
                Sample::new(self.buttons, None, &self.shown(now_ns)).write(request, &mut answer);
                self.sampled.push(now_ns);
                if !self.wire.withholds() {
                    self.send(&answer, line_baud, now_ns);
                }
            }
            _ => {
                let answer = questions.into_iter().find(|q| q.byte() == byte).and_then(|q| self.answer(q));
                if let Some(answer) = answer {
                    self.send(&[&[byte][..], &answer].concat(), line_baud, now_ns);
                }
            }
        }
    }
}

impl Peer for Twin {
    fn open(&mut self, _now_ns: i64) -> Result<(), LineError> {
        if self.plugged { Ok(()) } else { Err(LineError::Absent("no such file".into())) }
    }

    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64) {
        if !self.plugged || self.hung {
            return;
        }
        for byte in bytes {
            // Outside a session it detects the rate. Within one, bytes at another rate are
            // unreadable, except for the byte that ends the session.
            if baud != 0 && baud != self.baud {
                if baud > self.fastest_baud {
                    return;
                }
                if self.session != Session::None && *byte != 0xc5 {
                    continue;
                }
                (self.baud, self.session) = (baud, Session::None);
                self.input.clear();
            }
            if self.session == Session::Begun {
                self.obey(*byte, baud, now_ns);
                continue;
            }
            if *byte == 0xc5 {
                self.session = Session::None;
                self.input.clear();
                continue;
            }
            self.input.push(*byte);
            if self.session == Session::None && self.input.ends_with(SIGNATURE) {
                self.session = Session::Signed;
                self.input.clear();
                self.send(SIGNATURE, baud, now_ns);
            } else if self.session == Session::Signed && self.input.ends_with(BEGIN) {
                self.session = Session::Begun;
                self.input.clear();
                self.send(b"MSCR\0", baud, now_ns);
            }
            if self.input.len() > 64 {
                self.input.clear();
            }
        }
    }

    fn next(&mut self, _baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
        if !self.plugged {
            return Err(LineError::Gone("unplugged".into()));
        }
        match self.wire.due() {
            Some(at) if at <= until_ns => Ok(self.wire.receive(at.max(now_ns))),
            _ => Ok(None),
        }
    }

    fn due(&self, _now_ns: i64) -> Option<i64> {
        self.wire.due()
    }
}
