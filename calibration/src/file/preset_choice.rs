//! Choice of a preset of a calibration file, for the scanner's depth.

use super::CalibrationFile;
use super::preset::Preset;
use crate::error::PresetError;

impl CalibrationFile {
    /// Selects a preset: its image pose, record, clip and fan replace the file's. Without a
    /// name it selects the only preset, unless the file itself has an `image_to_probe`. Returns
    /// the selected preset, if any.
    ///
    /// # Errors
    /// [`PresetError`] if none has that name, or if there are several and no name.
    pub fn choose(&mut self, name: Option<&str>) -> Result<Option<Preset>, PresetError> {
        let known = || self.presets.iter().map(|preset| preset.name.clone()).collect();
        let chosen = match (name, &self.presets[..]) {
            (Some(name), presets) => match presets.iter().find(|preset| preset.name == name) {
                Some(preset) => preset.clone(),
                None => return Err(PresetError::Unknown { name: name.to_owned(), known: known() }),
            },
            (None, _) if self.probe_from_image.is_some() => return Ok(None),
            (None, []) => return Ok(None),
            (None, [only]) => only.clone(),
            (None, _) => return Err(PresetError::Unnamed { known: known() }),
        };
        self.probe_from_image = Some(chosen.probe_from_image);
        self.record = chosen.record.clone();
        self.clip = chosen.clip.or(self.clip);
        self.fan = chosen.fan.or(self.fan);
        Ok(Some(chosen))
    }
}
