//! OpenIGTLink: the protocol of image-guided therapy, versions 1 to 3, as bytes; and a server of it as a device.
//!
//! The bytes are without transport and clock, as in every wire format here. By the protocol's documents (openigtlink/OpenIGTLink, Documents/Protocol); what they leave open is as the
//! reference library writes it, whose own vectors are among the tests.
//!
//! ```text
//! 0        2              14               34          42           50     58
//! | version | type name    | device name    | time      | body size  | CRC  | body …
//! body of header version 1:  content
//! body of header version 2:  extended header (12) | content | metadata header | metadata
//! ```
//!
//! Everything is big endian but an image's pixels, which say what they are. Protocol versions 1 and 2 have header version 1; version 3 has header version 2, and adds
//! the message's number and metadata. The checksum is ECMA-182's, over the body.
//!
//! - [`stream`]: from a stream, cut anywhere, to messages; what becomes of bytes that are none.
//! - [`message`]: a message, whole.
//! - [`header`]: what each begins with. [`extended`]: what version 3 adds.
//! - [`image`], [`pose`], [`words`], [`query`]: what messages hold.
//! - [`client`]: what is said to a server, and what its messages are as readings; [`driver`] opens it.

pub mod client;
mod cursor;
pub mod driver;
pub mod extended;
pub mod fixed;
pub mod header;
pub mod image;
pub mod message;
pub mod pose;
pub mod query;
pub mod stream;
pub mod words;

pub use client::{Client, RemotePictures, RemoteSettings, RemoteTransforms};
pub use cursor::Fault;
pub use driver::RemoteDriver;
pub use extended::{Datum, Text};
pub use fixed::{Fixed, Unfit};
pub use header::{Header, TimeStamp, Version};
pub use image::{Coordinates, Image};
pub use message::{Content, Message, Unwritable};
pub use pose::{Matrix, Position, Tool, ToolKind};
pub use query::{Pace, Subject};
pub use stream::{Decoder, Event, Limits, Refused};
pub use words::{Command, Status};
