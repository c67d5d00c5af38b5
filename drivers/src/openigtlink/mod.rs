//! OpenIGTLink: the protocol of image-guided therapy, versions 1 to 3, as bytes; and a driver for
//! servers.
//!
//! The wire format is independent of transport and clock, like all wire formats here. It follows
//! the protocol's documents (openigtlink/OpenIGTLink, Documents/Protocol). Where they are
//! ambiguous, it follows the reference library, whose own vectors are among the tests.
//!
//! ```text
//! 0        2              14               34          42           50     58
//! | version | type name    | device name    | time      | body size  | CRC  | body …
//! body of header version 1:  content
//! body of header version 2:  extended header (12) | content | metadata header | metadata
//! ```
//!
//! Everything is big-endian except an image's pixels, which state their byte order. Protocol
//! versions 1 and 2 have header version 1; version 3 has header version 2, and adds the message
//! number and metadata. The checksum is ECMA-182's, over the body.
//!
//! - [`stream`]: splits a byte stream into messages, and recovers after invalid bytes.
//! - [`message`]: a whole message.
//! - [`header`]: its header. [`extended`]: the additions of version 3.
//! - [`image`], [`pose`], [`words`], [`query`]: contents of messages.
//! - [`client`]: requests to a server, and the conversion of its messages to readings; [`driver`]
//!   opens it.

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
mod unwritable;
pub mod words;

pub use client::{Client, RemotePictures, RemoteSettings, RemoteTransforms};
pub use cursor::Fault;
pub use driver::{list, open};
pub use extended::{Datum, Text};
pub use fixed::{Fixed, Unfit};
pub use header::{Header, TimeStamp, Version};
pub use image::{Coordinates, Image};
pub use message::{Content, Message};
pub use pose::{Matrix, Position, Tool, ToolKind};
pub use query::{Pace, Subject};
pub use stream::{Decoder, Event, Limits, Refused};
pub use unwritable::Unwritable;
pub use words::{Command, Status};
