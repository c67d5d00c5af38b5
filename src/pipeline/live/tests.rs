//! The stages by themselves.
