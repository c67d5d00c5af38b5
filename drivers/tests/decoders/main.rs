//! What every decoder promises, on streams of every wire format: written vectors, any cut, garbage, arbitrary bytes, encode and decode.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

mod ea1;
mod ea1_sketch;
mod fastrak;
mod isotrak;
mod liberty;
mod microscribe;
mod qsb;
mod stream;
mod viper;
