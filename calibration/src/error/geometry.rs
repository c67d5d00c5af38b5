//! Errors of a phantom's geometry.

/// Reasons why numbers do not describe a phantom, its drawing, or its registration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// There are neither wires nor landmarks.
    #[error("the phantom has neither wires nor landmarks; give some")]
    Empty,
    /// Two items have the same name.
    #[error("two {what} are called {name}; give each its own name")]
    Twice {
        /// Wires or landmarks.
        what: &'static str,
        /// Their name.
        name: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("a coordinate of {name} is not a finite number; correct it")]
    NotFinite {
        /// Name of the wire or landmark.
        name: String,
    },
    /// Both ends of a wire coincide.
    #[error("the wire {name} is {mm} mm long; give ends that are farther apart")]
    Short {
        /// Name of the wire.
        name: String,
        /// Its length, mm.
        mm: f64,
    },
    /// The size is implausible.
    #[error("the phantom's longest side is {mm} mm, which is implausible; give its numbers in mm")]
    Size {
        /// The longest side, mm.
        mm: f64,
    },
    /// No three wires make an N.
    #[error("no three wires make an N (two parallel wires, and one aslant between them in their plane); add one")]
    NoN,
    /// The N's do not lie one above the other.
    #[error("the N's lie in one plane, so that up and down are unknown; give N's one above the other")]
    Flat,
    /// A wire ends elsewhere.
    #[error(
        "the wire {wire} ends {mm:.2} mm off the plates that the wire {first} defines; give a phantom whose wires \
        between two parallel plates"
    )]
    Off {
        /// Name of the wire.
        wire: String,
        /// Distance of its end from the plate, mm.
        mm: f64,
        /// The wire that defines the plates' positions.
        first: String,
    },
    /// A registration's matrix is not rigid.
    #[error("{0}")]
    NotRigid(String),
    /// A registration's error is 0, negative or not finite.
    #[error("the registration's error is {mm} mm; give a number above 0")]
    RegistrationError {
        /// The given error, mm.
        mm: f64,
    },
}
