//! Style of the volume's picture in pages: the configured transfer function, or one that a user
//! with control has chosen.

use serde_json::{Value, json};

use render::RenderSettings;
use render::classify::transfer::{Curve, Opacity, Transfer};

use super::request_error::RequestError;

/// Most points that a page may give for an opacity curve.
const MOST_POINTS: usize = 16;
/// Largest accepted magnitude of a grey value.
const MOST_GREY: f64 = 1e6;

/// The configured style.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfiguredStyle {
    /// The configured transfer function.
    pub transfer: Transfer,
    /// Name of the preset or of the file it came from.
    pub name: String,
    /// Grey values displayed as black and as white.
    pub range: [f32; 2],
    /// Whether the configured composite mode uses opacities.
    pub uses_opacities: bool,
}

/// The style that a user requests.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Choice {
    /// Preset by name; `None` means the configured transfer function.
    pub preset: Option<String>,
    /// Points (grey value, opacity) that replace the preset's opacities.
    pub points: Option<Vec<[f64; 2]>>,
}

/// The style in use.
#[derive(Debug, Default)]
pub struct PresentStyle {
    configured: Option<ConfiguredStyle>,
    choice: Choice,
    /// Number of changes so far.
    changes: u64,
}

impl PresentStyle {
    /// Sets the configured style. Returns whether it differs from the one before.
    pub(super) fn configure(&mut self, configured: ConfiguredStyle) -> bool {
        let is_other = self.configured.as_ref() != Some(&configured);
        self.configured = Some(configured);
        self.changes += u64::from(is_other);
        is_other
    }

    /// Grey values displayed as black and as white.
    pub(super) fn range(&self) -> [f32; 2] {
        self.configured.as_ref().map_or([0.0, 255.0], |configured| configured.range)
    }

    /// A number that changes with the style; 0 while the style is the configured one.
    pub(super) fn number(&self) -> u64 {
        if self.choice == Choice::default() { 0 } else { self.changes }
    }

    /// Applies the chosen style to the render settings.
    pub(super) fn apply(&self, settings: &mut RenderSettings) {
        if self.choice != Choice::default()
            && let Some(Ok(transfer)) = self.configured.as_ref().map(|configured| made(configured, &self.choice))
        {
            settings.transfer = transfer;
        }
    }

    /// Chooses a style.
    ///
    /// # Errors
    /// [`RequestError`] if the choice yields no valid transfer function; the previous choice stays.
    pub(super) fn choose(&mut self, choice: Choice) -> Result<(), RequestError> {
        let configured = self.configured.as_ref().ok_or(RequestError::NoStyle)?;
        made(configured, &choice)?;
        if self.choice != choice {
            self.choice = choice;
            self.changes += 1;
        }
        Ok(())
    }

    /// The style as JSON, for pages.
    pub(super) fn to_json(&self) -> Value {
        let Some(configured) = &self.configured else { return json!({ "dress": null }) };
        let transfer = made(configured, &self.choice).unwrap_or_else(|_| configured.transfer.clone());
        let curve = match transfer.opacity() {
            Opacity::Curve(curve) => Some(curve.points().map(|(grey, [opacity])| [grey, opacity]).collect::<Vec<_>>()),
            Opacity::Isovalue { .. } | Opacity::Region(_) => None,
        };
        json!({ "dress": {
            "preset": self.choice.preset,
            "configured": configured.name,
            "presets": Transfer::PRESETS.map(|(name, purpose)| [name, purpose]),
            "points": curve,
            "drawn": self.choice.points.is_some(),
            "range": configured.range,
            "heeded": configured.uses_opacities,
        } })
    }
}

/// Returns the transfer function of a choice.
fn made(configured: &ConfiguredStyle, Choice { preset, points }: &Choice) -> Result<Transfer, RequestError> {
    let base = match preset {
        Some(name) => Transfer::preset(name, configured.range.map(f64::from))
            .map_err(|error| RequestError::Transfer(error.to_string()))?,
        None => configured.transfer.clone(),
    };
    let Some(points) = points else { return Ok(base) };
    if points.len() > MOST_POINTS {
        return Err(RequestError::CurvePoints { most: MOST_POINTS, given: points.len() });
    }
    if let Some([grey, _]) = points.iter().find(|[grey, _]| !(-MOST_GREY..=MOST_GREY).contains(grey)) {
        return Err(RequestError::CurveGrey { grey: *grey, most: MOST_GREY });
    }
    let points: Vec<(f64, f64)> = points.iter().map(|[grey, opacity]| (*grey, *opacity)).collect();
    let curve = Curve::new(&points).map_err(|error| RequestError::Curve(error.to_string()))?;
    let transfer = Transfer::new(Opacity::Curve(curve), base.unit_mm(), base.colours().clone());
    match base.gradient() {
        Some(gradient) => transfer.and_then(|transfer| transfer.with_gradient(gradient.clone())),
        None => transfer,
    }
    .map_err(|error| RequestError::Transfer(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn configured() -> ConfiguredStyle {
        let range = [0.0, 255.0];
        ConfiguredStyle {
            transfer: Transfer::preset("phantom", range.map(f64::from)).unwrap(),
            name: "phantom".into(),
            range,
            uses_opacities: true,
        }
    }

    fn applied(style: &PresentStyle) -> Transfer {
        let mut settings = RenderSettings::new([8, 8], configured().transfer);
        style.apply(&mut settings);
        settings.transfer
    }

    #[test]
    fn style_choice_applies_and_invalid_choice_changes_nothing() {
        let mut style = PresentStyle::default();
        assert!(style.choose(Choice::default()).unwrap_err().to_string().contains("no volume is drawn"));
        assert_eq!(style.to_json()["dress"], Value::Null);
        assert!(style.configure(configured()) && !style.configure(configured()));
        assert_eq!((style.number(), applied(&style)), (0, configured().transfer));
        let bone = Choice { preset: Some("bone".into()), points: None };
        style.choose(bone.clone()).unwrap();
        let number = style.number();
        assert_eq!(applied(&style), Transfer::preset("bone", [0.0, 255.0]).unwrap());
        style.choose(bone).unwrap();
        assert_eq!(style.number(), number, "the same again is no change");

        let curved =
            Choice { preset: Some("tissue".into()), points: Some(vec![[30.0, 0.0], [90.5, 0.25], [200.0, 1.0]]) };
        style.choose(curved).unwrap();
        assert_ne!(style.number(), number);
        let (tissue, transfer) = (Transfer::preset("tissue", [0.0, 255.0]).unwrap(), applied(&style));
        assert_eq!((transfer.colours(), transfer.gradient()), (tissue.colours(), tissue.gradient()));
        assert_eq!(style.to_json()["dress"]["points"], json!([[30.0, 0.0], [90.5, 0.25], [200.0, 1.0]]));

        let (number, to_json) = (style.number(), style.to_json());
        for (points, sentence) in [
            (vec![], "holds no points"),
            (vec![[10.0, 0.5], [10.0, 0.6]], "stands at 10, after a point at 10"),
            (vec![[10.0, 1.5]], "from 0 to 1"),
            (vec![[f64::NAN, 0.5]], "within ±1000000"),
            (vec![[10.0, f64::NAN]], "from 0 to 1"),
            (vec![[2e6, 0.5]], "within ±1000000"),
            ((0..17).map(|n| [f64::from(n), 0.5]).collect(), "at most 16 points"),
        ] {
            let refused = style.choose(Choice { preset: None, points: Some(points) }).unwrap_err().to_string();
            assert!(refused.contains(sentence), "{refused}");
        }
        let unknown = style.choose(Choice { preset: Some("velvet".into()), points: None }).unwrap_err().to_string();
        assert!(unknown.contains("\"velvet\"") && unknown.contains("xray"), "{unknown}");
        assert_eq!((style.number(), style.to_json(), applied(&style)), (number, to_json, transfer));
        style.choose(Choice::default()).unwrap();
        assert_eq!((style.number(), applied(&style)), (0, configured().transfer));
        // A surface preset has no curve to draw.
        style.choose(Choice { preset: Some("surface".into()), points: None }).unwrap();
        assert_eq!(style.to_json()["dress"]["points"], Value::Null);
    }
}
