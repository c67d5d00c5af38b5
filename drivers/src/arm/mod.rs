//! Encoder arms of three joints.
