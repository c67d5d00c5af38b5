//! Settings by which a page draws the session's picture of the volume.

use serde_json::{Value, json};

use render::camera::View;
use render::classify::light::{Light, Source};
use render::classify::transfer::{Opacity, Transfer};
use render::{Crop, Mode, RenderRegion, Renderer, Shading};

/// The settings of the session's picture, but for its view.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawing {
    pub(super) region: RenderRegion,
    /// Grey values of black and white: values of bricks are shares of them.
    pub(super) window: [f32; 2],
    /// The hidden parts: their voxels come as unseen.
    pub(crate) crop: Crop,
    size: [u32; 2],
    step: f64,
    arity: u32,
    stop: f32,
    mode: Mode,
    transfer: Transfer,
    light: Light,
    background: [f32; 3],
    /// Whether the volume has too many bricks.
    is_too_large: bool,
}

impl Drawing {
    /// Returns the settings of a renderer's present picture.
    pub(crate) fn of(renderer: &Renderer, background: [f32; 3], window: [f32; 2], is_too_large: bool) -> Self {
        let settings = renderer.settings();
        Self {
            region: *renderer.region(),
            window,
            crop: settings.crop.clone(),
            size: settings.size,
            step: settings.step,
            arity: renderer.arity(),
            stop: settings.stop,
            mode: settings.mode,
            transfer: settings.transfer.clone(),
            light: settings.light,
            background,
            is_too_large,
        }
    }

    /// Returns why pages cannot draw this.
    fn obstacle(&self) -> Option<&'static str> {
        if self.is_too_large {
            return Some("the volume is too large for a page");
        }
        match (self.mode, self.transfer.opacity()) {
            (Mode::Maximum | Mode::Average, _) => None,
            (Mode::Shaded(Shading::Voxel) | Mode::Opacity(Shading::Voxel), Opacity::Isovalue { .. }) => {
                Some("pages do not draw thin surfaces")
            }
            (Mode::Shaded(Shading::Voxel) | Mode::Opacity(Shading::Voxel), _) => None,
            _ => Some("pages do not draw this mode"),
        }
    }

    /// Returns whether pages can draw this.
    pub(super) fn is_possible(&self) -> bool {
        self.obstacle().is_none()
    }

    /// The settings as JSON, for pages. Tables have an entry for each of 256 values.
    pub(crate) fn to_json(&self) -> Value {
        if let Some(obstacle) = self.obstacle() {
            return json!({ "drawing": { "none": obstacle } });
        }
        let Self { region, window: [black, white], transfer, light, .. } = self;
        let [black, white] = [f64::from(*black), f64::from(*white)];
        let grey = |byte: u8| black + (white - black) * f64::from(byte) / 255.0;
        // Opacities of borders are per grey level per mm.
        let (curve, border_mm) = match transfer.opacity() {
            Opacity::Curve(curve) => (Some(curve), 0.0),
            Opacity::Region(curve) => {
                let [first, last] = curve.span();
                (Some(curve), transfer.unit_mm() / (last - first))
            }
            Opacity::Isovalue { .. } => (None, 0.0),
        };
        let opacities = table(|byte| curve.map_or(0.0, |curve| curve.value(grey(byte))));
        let is_grey = matches!(self.mode, Mode::Opacity(_) | Mode::Maximum | Mode::Average) || transfer.is_grey();
        let colours = table(|byte| match transfer.is_grey() {
            true => [transfer.intensity(grey(byte)); 3],
            false => transfer.colour(grey(byte)),
        });
        let gradient =
            transfer.gradient().map(|curve| curve.points().map(|(at, [factor])| [at, factor]).collect::<Vec<_>>());
        let towards = match light.source() {
            Source::Headlight => None,
            Source::Fixed(towards) => Some(towards.to_array()),
        };
        let [low, high] = region.bounds();
        json!({ "drawing": {
            "first": region.first(),
            "bricks": region.bricks(),
            "low": low,
            "high": high,
            "world_from_region": region.world_from_region().to_cols_array(),
            "window": [black, white],
            "size": self.size,
            "step": self.step,
            "arity": self.arity,
            "stop": self.stop,
            "mode": self.mode.name(),
            "grey": is_grey,
            "opacities": opacities,
            "border_mm": border_mm,
            "gradient": gradient,
            "unit_mm": transfer.unit_mm(),
            "colours": colours,
            "top": transfer.colours().span()[1],
            "light": {
                "parts": light.parts(),
                "two_sided": light.is_two_sided(),
                "towards": towards,
                "depth_cue": light.depth_cue(),
            },
            "background": self.background,
        } })
    }
}

/// Returns a function of each of 256 values.
fn table<T>(of: impl Fn(u8) -> T) -> Vec<T> {
    (0..=u8::MAX).map(of).collect()
}

/// A view as JSON. `steered` is the number of the page's own commands to the camera that the view
/// contains.
pub(crate) fn view_json(view: &View, steered: u64) -> Value {
    let View { azimuth, elevation, roll, perspective, turns, zoom, aim } = *view;
    json!({ "view": {
        "azimuth": azimuth,
        "elevation": elevation,
        "roll": roll,
        "perspective": perspective,
        "turns": turns,
        "zoom": zoom,
        "aim": aim.map(|aim| aim.to_array()),
        "steered": steered,
    } })
}
