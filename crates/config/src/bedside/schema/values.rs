//! Types of keys' values, shared by the sections. Each declares its own form in the schema.

use std::borrow::Cow;

use clap::ValueEnum;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::Value;

/// Values with names in files.
pub(crate) trait Named: Copy + PartialEq {
    /// Returns all of them.
    fn names() -> Vec<(String, Self)>;
}

/// Declares the names of values.
macro_rules! named {
    ($($type:ty: $names:expr;)*) => {$(
        impl $crate::bedside::schema::values::Named for $type {
            fn names() -> Vec<(String, Self)> {
                $names.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
            }
        }
    )*};
}
pub(crate) use named;

/// Returns the names of a flag's values.
pub(crate) fn of_flag<T: ValueEnum + Copy>(values: &[T]) -> Vec<(String, T)> {
    let name = |value: &T| value.to_possible_value().map(|name| (name.get_name().to_owned(), *value));
    values.iter().filter_map(name).collect()
}

/// One of several values, by its name.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Name<T>(pub(crate) T);

impl<T: Named> Serialize for Name<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        T::names().into_iter().find(|(_, value)| *value == self.0).map(|(name, _)| name).serialize(serializer)
    }
}

impl<'de, T: Named> Deserialize<'de> for Name<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let found = T::names().into_iter().find(|(name, _)| *name == text);
        // The schema's check, which has come before, lists the names.
        found.map(|(_, value)| Self(value)).ok_or_else(|| de::Error::custom("has no such name"))
    }
}

impl<T: Named> JsonSchema for Name<T> {
    fn schema_name() -> Cow<'static, str> {
        "Name".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let names: Vec<String> = T::names().into_iter().map(|(name, _)| name).collect();
        json_schema!({ "type": "string", "enum": names })
    }
}

/// A text, or a value of another kind.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum TextOr<T> {
    Text(String),
    Other(T),
}

impl<T: JsonSchema> JsonSchema for TextOr<T> {
    fn schema_name() -> Cow<'static, str> {
        "TextOr".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = T::json_schema(generator);
        let mut kinds = match schema.remove("type") {
            Some(Value::Array(kinds)) => kinds,
            kind => kind.into_iter().collect(),
        };
        kinds.push("string".into());
        schema.insert("type".into(), kinds.into());
        schema
    }
}

/// A value in a flag's notation, or its numbers.
pub(crate) type Notation = TextOr<Numbers>;

/// A number, or several.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Numbers {
    One(f64),
    Many(Vec<f64>),
}

impl JsonSchema for Numbers {
    fn schema_name() -> Cow<'static, str> {
        "Numbers".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": ["number", "array"], "items": { "type": "number" } })
    }
}

impl Notation {
    /// Returns the flag's notation, in which `by` joins numbers.
    pub(crate) fn joined(self, by: &str) -> String {
        match self {
            Self::Text(text) => text,
            Self::Other(Numbers::One(number)) => number.to_string(),
            Self::Other(Numbers::Many(all)) => all.iter().map(f64::to_string).collect::<Vec<_>>().join(by),
        }
    }
}

/// A file or folder.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[schemars(extend("x-takes" = "a path, from this file's folder"))]
pub(crate) struct RelativePath(pub(crate) String);

/// Latency of its times, beyond the delay of wire and sampling that the driver knows; default: the
/// calibration file's, else 0
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[schemars(extend("x-at-once" = true))]
pub(crate) struct LatencyMs(#[schemars(range(min = -1000, max = 1000))] pub(crate) f64);

/// Converts milliseconds to whole nanoseconds.
pub(crate) fn ns(ms: f64) -> i64 {
    // No overflow: even days would fit.
    (ms * 1e6).round() as i64
}
