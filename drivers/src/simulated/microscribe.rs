//! A virtual MicroScribe: once woken, it answers requests. Its encoders have 14 bits and count
//! from the position of the arm at power-on.

use sonoweave_core::clock::MS;
use sonoweave_core::reading::AXES;

use super::{Faults, Joints, Machine, Wire};
use crate::arm::microscribe::{BEGIN, Family, Question, Request, SIGNATURE, Sample};

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
    /// Its line, at the rate of the session.
    pub wire: Wire,
    /// The fastest rate that it detects, bits per second.
    pub fastest_baud: u32,
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
    /// Times of the samples sent, ns.
    pub sampled: Vec<i64>,
    input: Vec<u8>,
}

impl Twin {
    /// Creates a device that was switched on at home and has no session yet.
    pub fn new(joints: Joints, faults: Faults) -> Self {
        let home = [8192, 12_000, 14_000, 5000, 0, 16_383];
        Self {
            joints,
            wire: Wire::new(9600, faults),
            fastest_baud: 115_200,
            session: Session::None,
            home,
            offsets: home,
            maxima: [16_383, 16_383, 8191, 8191, 8191, 4095],
            buttons: 0,
            answers_links: true,
            sampled: Vec::new(),
            input: Vec::new(),
        }
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
        self.wire.send(bytes, line_baud, at_ns + THINKS);
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
        self.wire.obeyed.push(vec![byte]);
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

impl Machine for Twin {
    fn wire(&mut self) -> &mut Wire {
        &mut self.wire
    }

    /// Unplugs its cable; it stays switched on.
    fn unplug(&mut self) {
        self.wire.plugged = false;
        self.wire.cut();
        self.input.clear();
    }

    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        self.sampled.clear();
        std::mem::take(&mut self.wire.obeyed)
    }

    fn hear(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) {
        for byte in bytes {
            // Outside a session it detects the rate. Within one, bytes at another rate are
            // unreadable, except for the byte that ends the session.
            if self.wire.mistakes(line_baud) {
                if line_baud > self.fastest_baud {
                    return;
                }
                if self.session != Session::None && *byte != 0xc5 {
                    continue;
                }
                (self.wire.baud, self.session) = (line_baud, Session::None);
                self.input.clear();
            }
            if self.session == Session::Begun {
                self.obey(*byte, line_baud, now_ns);
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
                self.send(SIGNATURE, line_baud, now_ns);
            } else if self.session == Session::Signed && self.input.ends_with(BEGIN) {
                self.session = Session::Begun;
                self.input.clear();
                self.send(b"MSCR\0", line_baud, now_ns);
            }
            if self.input.len() > 64 {
                self.input.clear();
            }
        }
    }
}
