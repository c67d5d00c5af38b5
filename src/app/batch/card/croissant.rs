//! Croissant 1.0 (MLCommons): the tables of a card as JSON-LD, for programs that load data sets.

use serde_json::{Value, json};

use crate::app::json::document;
use crate::app::provenance::program;
use crate::app::sha256;
use crate::failure::Failure;

/// A table: the name of its file, and its text, whose first line has the names of the columns.
pub(super) type Table<'a> = (&'a str, &'a str);

/// Returns the description of a data set with these tables, beside which it lies.
///
/// # Errors
/// [`Failure`] for what JSON does not have; there is none.
pub(super) fn text(name: &str, license: Option<&str>, tables: &[Table<'_>]) -> Result<String, Failure> {
    let mut described = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": name,
        "description": format!(
            "Volumes of tracked freehand ultrasound, reconstructed by sonoweave {}. For research.",
            program()
        ),
        "distribution": tables.iter().map(file).collect::<Vec<_>>(),
        "recordSet": tables.iter().map(records).collect::<Vec<_>>(),
    });
    if let Some(license) = license {
        described["license"] = license.into();
    }
    document(&described)
}

fn file(&(name, text): &Table<'_>) -> Value {
    json!({
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "encodingFormat": "text/tab-separated-values",
        "sha256": sha256::of(text.as_bytes()),
    })
}

fn records(&(name, text): &Table<'_>) -> Value {
    let set = name.trim_end_matches(".tsv");
    let field = |column: &str| {
        json!({
            "@type": "cr:Field",
            "@id": format!("{set}/{column}"),
            "name": column,
            "dataType": data_type(column),
            "source": { "fileObject": { "@id": name }, "extract": { "column": column } },
        })
    };
    let columns = text.lines().next().unwrap_or_default().split('\t');
    json!({ "@type": "cr:RecordSet", "@id": set, "name": set, "field": columns.map(field).collect::<Vec<_>>() })
}

fn data_type(column: &str) -> &'static str {
    match column {
        "run" | "sessions" | "sweeps" | "frames" | "frames_used" => "sc:Integer",
        "seconds" => "sc:Float",
        _ => "sc:Text",
    }
}

/// The context that version 1.0 prescribes.
fn context() -> Value {
    let names = [
        "citeAs",
        "column",
        "equivalentProperty",
        "extract",
        "field",
        "fileObject",
        "fileProperty",
        "fileSet",
        "format",
        "includes",
        "isLiveDataset",
        "jsonPath",
        "key",
        "md5",
        "parentField",
        "path",
        "recordSet",
        "references",
        "regex",
        "repeated",
        "replace",
        "samplingRate",
        "separator",
        "source",
        "subField",
        "transform",
    ];
    let mut context = json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "sc": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "dct": "http://purl.org/dc/terms/",
        "conformsTo": "dct:conformsTo",
        "data": { "@id": "cr:data", "@type": "@json" },
        "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "examples": { "@id": "cr:examples", "@type": "@json" },
    });
    for name in names {
        context[name] = format!("cr:{name}").into();
    }
    context
}
