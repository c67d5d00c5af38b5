//! The flags of the light.

use clap::Args;

use render::classify::light::{DepthCue, Light, Source};

use crate::cli::{Failure, values};

/// The light, if it is not the default one.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Light (modes shaded and iso)")]
pub(in crate::cli) struct Lighting {
    /// Direction of the light: headlight (at the eye), or the direction towards it in the world,
    /// of any length [default: headlight]
    #[arg(long, value_name = "headlight|X,Y,Z", value_parser = values::light, allow_hyphen_values = true)]
    light: Option<Source>,
    /// Part of the light that comes from all sides, 0 to 1 [default: 0.3]
    #[arg(long, value_name = "PART", allow_hyphen_values = true)]
    ambient: Option<f64>,
    /// Part that a surface scatters evenly, 0 to 1 [default: 0.7]
    #[arg(long, value_name = "PART", allow_hyphen_values = true)]
    diffuse: Option<f64>,
    /// Part that it reflects as a highlight, 0 to 1 [default: 0.2]
    #[arg(long, value_name = "PART", allow_hyphen_values = true)]
    specular: Option<f64>,
    /// Exponent of the highlight: the larger, the narrower [default: 16]
    #[arg(long, value_name = "N")]
    shininess: Option<u32>,
    /// Light the backs of surfaces too: the walls of dark bodies seen from inside [default:
    /// true]
    #[arg(long, value_name = "true|false")]
    two_sided: Option<bool>,
    /// Brightness of the nearest and the farthest point, to show depth: 1 ≥ NEAR ≥ FAR > 0
    /// [default: no fading]
    #[arg(long, value_name = "NEAR,FAR", value_parser = values::depth_cue, allow_hyphen_values = true)]
    depth_cue: Option<Brightness>,
}

// clap takes an array for its own notation of repeated values; a named type is a single value to
// it.
type Brightness = [f64; 2];

impl Lighting {
    /// Returns the first given setting, if any.
    pub(super) fn given(&self) -> Option<&'static str> {
        [
            ("light", self.light.is_some()),
            ("ambient", self.ambient.is_some()),
            ("diffuse", self.diffuse.is_some()),
            ("specular", self.specular.is_some()),
            ("shininess", self.shininess.is_some()),
            ("two_sided", self.two_sided.is_some()),
            ("depth_cue", self.depth_cue.is_some()),
        ]
        .into_iter()
        .find_map(|(setting, given)| given.then_some(setting))
    }

    /// Returns the light.
    ///
    /// # Errors
    /// [`Failure`] for an impossible light.
    pub(super) fn light(&self) -> Result<Light, Failure> {
        let usual = Light::default();
        let parts = usual.parts();
        let light = usual.with_parts(
            self.ambient.unwrap_or(parts.ambient),
            self.diffuse.unwrap_or(parts.diffuse),
            self.specular.unwrap_or(parts.specular),
            self.shininess.unwrap_or(parts.shininess),
        )?;
        let light = light.with_source(self.light.unwrap_or(usual.source()))?;
        let cue = self.depth_cue.map(|[near, far]| DepthCue::new(near, far)).transpose()?;
        Ok(light.with_two_sided(self.two_sided.unwrap_or(usual.is_two_sided())).with_depth_cue(cue))
    }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser};
    use glam::DVec3;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        lighting: Lighting,
    }

    fn light(words: &str) -> Result<Light, String> {
        let command = Command::try_parse_from(std::iter::once("x").chain(words.split_whitespace()));
        command
            .map_err(|e| e.to_string())?
            .lighting
            .light()
            .map_err(|Failure(crate::failure::Reason { sentence, .. })| sentence)
    }

    #[test]
    fn help_defaults_match_light_defaults() {
        assert_eq!(light("").unwrap(), Light::default());
        let parts = Light::default().parts();
        let help = Command::command().render_long_help().to_string();
        for value in [parts.ambient, parts.diffuse, parts.specular, f64::from(parts.shininess)] {
            assert!(help.contains(&format!("[default: {value}]")), "{value}: {help}");
        }
        let flags = "--light headlight --ambient 0.3 --diffuse 0.7 --specular 0.2 --shininess 16 --two-sided true";
        assert_eq!(light(flags).unwrap(), Light::default());
        let given = |words: [&str; 2]| Command::parse_from(["x", words[0], words[1]]).lighting.given();
        assert_eq!(given(["--two-sided", "false"]), Some("two_sided"));
        assert_eq!(given(["--depth-cue", "1,0.5"]), Some("depth_cue"));
    }

    #[test]
    fn every_flag_reaches_light() {
        let made = light(
            "--light 0,0,-2 --ambient 0.1 --diffuse 0.2 --specular 0.4 --shininess 3 --two-sided false --depth-cue 0.9,0.5",
        );
        let exact = Light::default()
            .with_parts(0.1, 0.2, 0.4, 3)
            .and_then(|light| light.with_source(Source::Fixed(DVec3::NEG_Z)))
            .unwrap()
            .with_two_sided(false)
            .with_depth_cue(Some(DepthCue::new(0.9, 0.5).unwrap()));
        assert_eq!(made.unwrap(), exact);
    }

    #[test]
    fn impossible_light_refused_with_reason() {
        for (words, text) in [
            ("--ambient -0.1", "the ambient part of the light must lie between 0 and 1, not -0.1"),
            ("--specular nan", "the specular part"),
            ("--shininess 0", "exponent must be 1 or more"),
            ("--light 0,0,0", "finite and not zero"),
            ("--light sun", "headlight"),
            ("--depth-cue 0.5,0.9", "brightness must fall"),
            ("--depth-cue 1,0", "brightness must fall"),
            ("--depth-cue 1", "2 numbers"),
        ] {
            let refused = light(words).unwrap_err();
            assert!(refused.contains(text), "{words}: {refused}");
        }
    }
}
