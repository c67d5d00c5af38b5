//! Checks the files for a fleet of bedsides (`packaging/fleet`): alerts and dashboard name metrics
//! that a session has, by `docs/interface.txt`, which a test compares with `/metrics`. Each alert
//! has a case in which it is raised, and one in which it is not. `scripts/interop/fleet.sh` checks
//! them by Prometheus itself.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde_json::Value;
use yaml_rust2::{Yaml, YamlLoader};

const PAGES: [&str; 3] = ["docs/fleet.md", "docs/http.md", "docs/remote.md"];
/// Functions whose argument is a counter.
const OF_COUNTERS: [&str; 3] = ["rate(", "increase(", "resets("];

fn read(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root");
    fs::read_to_string(root.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn yaml(text: &str) -> Yaml {
    YamlLoader::load_from_str(text).expect("YAML").remove(0)
}

/// Kinds of the metrics in the list of the interface, by name.
fn metrics(interface: &str) -> BTreeMap<&str, &str> {
    let (_, listed) = interface.split_once("\n## Metrics\n").expect("a list of metrics");
    listed.lines().filter_map(|line| line.split_once(": ")?.0.split_once(' ')).collect()
}

/// Names of metrics in a text, with their positions.
fn named(text: &str) -> Vec<(usize, &str)> {
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let starts = text.char_indices().filter(|&(at, c)| is_part(c) && !text[..at].ends_with(is_part));
    let words = starts.map(|(at, _)| (at, &text[at..at + text[at..].find(|c| !is_part(c)).unwrap_or(text.len() - at)]));
    words.filter(|(_, word)| word.starts_with("sonoweave_") || word.starts_with("process_")).collect()
}

/// Returns the kind of a metric; `counter` for the series of a histogram.
fn kind<'a>(known: &BTreeMap<&str, &'a str>, name: &str) -> Option<&'a str> {
    let of_histogram = ["_bucket", "_sum", "_count"].iter().filter_map(|end| name.strip_suffix(end));
    let is_one = of_histogram.into_iter().any(|family| known.get(family) == Some(&"histogram"));
    if is_one { Some("counter") } else { known.get(name).copied().filter(|kind| *kind != "histogram") }
}

/// Returns the faults of a query: unknown metrics, counters without a rate, rates of gauges.
fn faults(known: &BTreeMap<&str, &str>, query: &str) -> Vec<String> {
    let fault = |(at, name): (usize, &str)| {
        let has_rate = OF_COUNTERS.iter().any(|function| query[..at].ends_with(function));
        match kind(known, name) {
            None => Some(format!("{name} is no metric: {query}")),
            Some("counter") if !has_rate => Some(format!("{name} is a counter without a rate: {query}")),
            Some("gauge") if has_rate => Some(format!("{name} is a gauge with a rate: {query}")),
            Some(_) => None,
        }
    };
    named(query).into_iter().filter_map(fault).collect()
}

/// Returns the alerts: name, query, and the sentences of their annotations.
fn alerts(rules: &Yaml) -> Vec<(&str, &str, [&str; 2])> {
    let groups = rules["groups"].as_vec().expect("groups");
    let rules = groups.iter().flat_map(|group| group["rules"].as_vec().expect("rules"));
    let mut found = Vec::new();
    for rule in rules {
        let text = |name: &str| rule[name].as_str().unwrap_or_default();
        let annotations = ["summary", "action"].map(|name| rule["annotations"][name].as_str().unwrap_or_default());
        found.push((text("alert"), text("expr"), annotations));
    }
    found
}

/// Returns the alerts that the cases raise, and those that they refute.
fn cases(tests: &Yaml) -> [BTreeSet<String>; 2] {
    let mut found = [BTreeSet::new(), BTreeSet::new()];
    let tests = tests["tests"].as_vec().expect("tests");
    for case in tests.iter().flat_map(|test| test["alert_rule_test"].as_vec().expect("cases")) {
        let is_raised = case["exp_alerts"].as_vec().is_some_and(|alerts| !alerts.is_empty());
        found[usize::from(!is_raised)].insert(case["alertname"].as_str().expect("a name").to_owned());
    }
    found
}

/// Adds all queries of a dashboard.
fn queries(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            for name in ["expr", "query"] {
                found.extend(fields.get(name).and_then(Value::as_str).map(str::to_owned));
            }
            fields.values().for_each(|inner| queries(inner, found));
        }
        Value::Array(items) => items.iter().for_each(|inner| queries(inner, found)),
        _ => {}
    }
}

#[test]
fn alerts_name_metrics_and_have_cases_and_advice() {
    let interface = read("docs/interface.txt");
    let (known, page) = (metrics(&interface), read("docs/fleet.md"));
    let (rules, tests) = (yaml(&read("packaging/fleet/rules.yml")), yaml(&read("packaging/fleet/rules_test.yml")));
    let [raised, refuted] = cases(&tests);
    let alerts = alerts(&rules);
    assert!(alerts.len() >= 8, "{alerts:?}");
    for (name, query, sentences) in alerts {
        assert_eq!(faults(&known, query), [""; 0], "{name}");
        assert!(query.starts_with("up") || query.contains("up{") || !named(query).is_empty(), "{name}: {query}");
        assert!(sentences.iter().all(|text| text.ends_with('.')), "{name}: {sentences:?}");
        assert!(raised.contains(name) && refuted.contains(name), "{name} has no case, or none against it");
        assert!(page.contains(&format!("| `{name}` |")), "{name} is not on the page");
    }
}

#[test]
fn dashboard_asks_for_metrics_by_its_variables() {
    let interface = read("docs/interface.txt");
    let known = metrics(&interface);
    let dashboard: Value = serde_json::from_str(&read("packaging/fleet/dashboard.json")).expect("JSON");
    let mut found = Vec::new();
    queries(&dashboard, &mut found);
    assert!(found.len() > 25, "{found:?}");
    let list = dashboard["templating"]["list"].as_array().expect("variables");
    let variables: BTreeSet<&str> = list.iter().filter_map(|variable| variable["name"].as_str()).collect();
    assert!(["site", "bedside"].iter().all(|name| variables.contains(name)), "{variables:?}");
    for query in &found {
        assert_eq!(faults(&known, query), [""; 0]);
        for part in query.split('$').skip(1) {
            let name: String = part.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            assert!(name == "__rate_interval" || variables.contains(name.as_str()), "${name} in {query}");
        }
    }
    for panel in dashboard["panels"].as_array().expect("panels").iter().filter(|panel| panel["type"] != "row") {
        let description = panel["description"].as_str().unwrap_or_default();
        let has_queries = panel["targets"].as_array().is_some_and(|targets| !targets.is_empty());
        assert!(description.ends_with('.') && has_queries, "{}", panel["title"]);
    }
}

#[test]
fn pages_name_metrics_of_the_interface() {
    let interface = read("docs/interface.txt");
    let known = metrics(&interface);
    for page in PAGES {
        let text = read(page);
        let unknown: Vec<_> = named(&text).into_iter().filter(|(_, name)| kind(&known, name).is_none()).collect();
        assert!(unknown.is_empty(), "{page}: {unknown:?}");
    }
}

#[test]
fn unknown_metrics_and_absent_cases_are_found() {
    let known =
        metrics("a\n\n## Metrics\n\nsonoweave_x_total counter: X.\nsonoweave_y gauge: Y.\nsonoweave_z histogram: Z.\n");
    for query in ["rate(sonoweave_x_total{a=\"b\"}[1m])", "sonoweave_y > 1", "sum(rate(sonoweave_z_bucket[1m]))"] {
        assert_eq!(faults(&known, query), [""; 0]);
    }
    for (query, fault) in [
        ("sonoweave_w == 1 or sonoweave_y", "sonoweave_w is no metric"),
        ("sonoweave_x_total > 1", "is a counter without a rate"),
        ("rate(sonoweave_y[1m])", "is a gauge with a rate"),
        ("sonoweave_z", "sonoweave_z is no metric"),
        ("rate(sonoweave_y_bucket[1m])", "sonoweave_y_bucket is no metric"),
    ] {
        let found = faults(&known, query);
        assert!(found.len() == 1 && found[0].contains(fault), "{query}: {found:?}");
    }
    let tests = "tests:\n  - alert_rule_test:\n      - {alertname: A, exp_alerts: []}\n      - {alertname: B, exp_alerts: [{exp_labels: {}}]}\n";
    assert_eq!(cases(&yaml(tests)), [["B".to_owned()].into(), ["A".to_owned()].into()]);
    let mut found = Vec::new();
    queries(&serde_json::json!({ "a": [{ "expr": "x" }], "query": { "query": "y" } }), &mut found);
    found.sort();
    assert_eq!(found, ["x", "y"]);
}
