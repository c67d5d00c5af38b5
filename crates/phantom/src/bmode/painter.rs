//! The painter: renders B-mode images of a body by a scanner.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use mask::Mask;
use simd::Simd;
use sonoweave_core::frames::{Transform, World};

use super::beam::{Loss, Way};
use super::display::{Detect, Display, Show};
use super::echo::{Beams, Ringing, Wires};
use super::raster::Raster;
use super::scatter::{Add, Batch, Scatter};
use super::spread::Spread;
use super::{Layout, Scanner};
use crate::PhantomError;
use crate::body::{Body, Nearby};
use crate::trajectory::PictureMm;

/// A scanner over a body, ready to paint. It is immutable: threads share it, each with a
/// [`Workspace`] of its own.
#[derive(Debug, Clone)]
pub struct BMode {
    scanner: Scanner,
    body: Arc<Body>,
    layout: Layout,
    mask: Mask,
    scatter: Scatter,
    spread: Spread,
    loss: Loss,
    ringing: Ringing,
    display: Display,
    pub(super) simd: Simd,
}

/// Buffers for an image, reused for all images of the [`BMode`] that created them.
#[derive(Debug, Clone)]
pub struct Workspace {
    raster: Raster,
    row: [Vec<f32>; 2],
    /// Squared amplitudes before amplification, a row of beams for each range; compressed to
    /// grey levels once displayed.
    pub(super) power: Vec<f32>,
    batch: Box<Batch>,
    nearby: Nearby,
    way: Way,
    scatterers: u64,
}

impl Workspace {
    /// Returns the number of scatterers in the last image.
    pub fn scatterers(&self) -> u64 {
        self.scatterers
    }
}

impl BMode {
    /// Prepares to paint images of a given size, with pixels of a given size (mm).
    ///
    /// # Errors
    /// [`PhantomError`] for an invalid scanner, and for a field that lies beside the image.
    pub fn new(
        scanner: Scanner,
        body: Arc<Body>,
        image_size: [u32; 2],
        pixel_mm: [f64; 2],
    ) -> Result<Self, PhantomError> {
        let layout = Layout::new(&scanner, image_size, pixel_mm)?;
        let mask = layout.mask();
        if mask.area() == 0 {
            let [width, height] = image_size;
            return Err(PhantomError::EmptyFan { width, height });
        }
        let spread = Spread::new(&scanner, &layout);
        Ok(Self {
            scatter: Scatter::new(&scanner, &layout, &body),
            loss: Loss::new(&scanner, &body),
            ringing: Ringing::new(&scanner, &layout, &spread),
            display: Display::new(&scanner, &layout, &mask),
            simd: Simd::detect(),
            scanner,
            body,
            layout,
            mask,
            spread,
        })
    }

    /// Returns the memory of its tables and of a workspace, bytes.
    pub fn bytes(&self) -> u64 {
        let Layout { rows, columns, .. } = self.layout;
        // A workspace has the raster's real and imaginary parts, and powers.
        let workspace = 3 * rows * columns * size_of::<f32>() + size_of::<Batch>();
        (self.display.bytes() + self.ringing.bytes() + workspace) as u64
    }

    /// Returns the scanner.
    pub fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    /// Returns the body.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Returns the geometry of beams and pixels.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the mask of data pixels; the others are black.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Creates buffers for an image.
    pub fn workspace(&self) -> Workspace {
        Workspace {
            raster: Raster::new(&self.layout),
            row: [0, 1].map(|_| vec![0.0; self.layout.columns]),
            power: vec![0.0; self.layout.rows * self.layout.columns],
            batch: Box::new(Batch::new()),
            nearby: Nearby::with_room_for(&self.body),
            way: Way::with_room_for(&self.body),
            scatterers: 0,
        }
    }

    /// Paints the image of a plane, u fastest. The frame number selects the noise.
    ///
    /// # Panics
    /// If `picture` does not have the configured number of pixels, or the workspace belongs to
    /// another painter.
    pub fn paint(
        &self,
        world_from_picture: &Transform<World, PictureMm>,
        frame: u32,
        room: &mut Workspace,
        picture: &mut [u8],
    ) {
        let [width, height] = self.layout.image_size.map(|n| n as usize);
        assert_eq!(picture.len(), width * height, "the pixels do not fill the picture");
        self.echoes(world_from_picture, frame, room);
        picture.fill(0);
        self.simd.fused(Show { display: &self.display, layout: &self.layout, power: &mut room.power, picture });
    }

    /// Computes the squared amplitudes of a plane's echoes, before amplification, in the
    /// workspace.
    pub(super) fn echoes(&self, world_from_picture: &Transform<World, PictureMm>, frame: u32, room: &mut Workspace) {
        assert_eq!(room.power.len(), self.layout.rows * self.layout.columns, "the room is another painter's");
        let face = DVec3::new(0.0, self.layout.face_below_middle_mm(), 0.0);
        let body_from_face =
            self.body.world_from_body.inverse() * world_from_picture.affine() * DAffine3::from_translation(face);
        let face_from_body = body_from_face.inverse();
        let effects = self.scanner.effects;
        room.raster.clear();
        room.scatterers = 0;
        if effects.speckle {
            room.scatterers = self.simd.fused(Add {
                scatter: &self.scatter,
                layout: &self.layout,
                spread: &self.spread,
                body: &self.body,
                body_from_face: &body_from_face,
                raster: &mut room.raster,
                batch: &mut room.batch,
                nearby: &mut room.nearby,
            });
        }
        let beams = Beams {
            scanner: &self.scanner,
            layout: &self.layout,
            spread: &self.spread,
            body: &self.body,
            loss: &self.loss,
            body_from_face: &body_from_face,
        };
        beams.follow(&mut room.raster, &mut room.way);
        if effects.wires {
            Wires { beams, face_from_body: &face_from_body }.add(&mut room.raster, &mut room.way);
        }
        self.ringing.add(&mut room.raster);
        self.simd.fused(Detect {
            display: &self.display,
            spread: &self.spread,
            layout: &self.layout,
            frame,
            raster: &mut room.raster,
            row: &mut room.row,
            power: &mut room.power,
        });
    }
}
