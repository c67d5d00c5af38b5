//! Results of a run: figures, claims with ours beside them, and failed checks.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use sonoweave_figures::{Figure, Findings, files, lettering};

/// A claim of the paper and the result of this run.
#[derive(Debug, Clone)]
pub(crate) struct Claim {
    pub(crate) id: &'static str,
    pub(crate) claim: &'static str,
    pub(crate) paper: &'static str,
    pub(crate) ours: String,
    pub(crate) verdict: &'static str,
}

#[derive(Debug, Default)]
pub(crate) struct Report {
    findings: Findings,
    claims: Vec<Claim>,
    /// Checks by the claim that they belong to: failed and passed.
    checks: BTreeMap<String, [u32; 2]>,
}

impl Report {
    /// Same as [`Findings::figure`].
    pub(crate) fn figure(&mut self, figure: Figure, folder: &Path) -> Result<(), Box<dyn Error>> {
        self.findings.figure(figure, folder)
    }

    /// Adds a claim; the verdict is `yes` if `holds`, else `no`.
    pub(crate) fn claim(
        &mut self,
        [id, claim, paper]: [&'static str; 3],
        ours: String,
        holds: bool,
        [yes, no]: [&'static str; 2],
    ) {
        self.claims.push(Claim { id, claim, paper, ours, verdict: if holds { yes } else { no } });
    }

    /// Adds a claim that holds if its checks were made and all of them have passed.
    pub(crate) fn checked_claim(&mut self, [id, claim, paper]: [&'static str; 3], ours: String, yes: &'static str) {
        let [failed, passed] = self.checks.get(id).copied().unwrap_or_default();
        self.claim([id, claim, paper], ours, failed == 0 && passed > 0, [yes, "not confirmed: a check has failed"]);
    }

    /// Same as [`Findings::check`]. The text begins with the claim that the check belongs to, if
    /// there is one, and a colon.
    pub(crate) fn check(&mut self, holds: bool, what: impl Into<String>) {
        let what = what.into();
        if let Some((id, _)) = what.split_once(": ") {
            self.checks.entry(id.to_owned()).or_default()[usize::from(holds)] += 1;
        }
        self.findings.check(holds, what);
    }

    /// Checks that a number equals `expected` within a relative tolerance `part`.
    pub(crate) fn near(&mut self, what: &str, found: f64, expected: f64, part: f64) {
        let holds = (found - expected).abs() <= part * expected.abs();
        self.check(holds, format!("{what}: {found} where {expected} is expected, within a part of {part}"));
    }

    /// Writes the table and the page; returns whether all checks passed.
    pub(crate) fn finish(mut self, folder: &Path, run: &str) -> Result<bool, Box<dyn Error>> {
        let number = |claim: &Claim| claim.id.trim_start_matches('C').parse::<u32>().unwrap_or(u32::MAX);
        self.claims.sort_by_key(number);
        fs::write(folder.join("claims.md"), self.markdown(run))?;
        let mut csv = String::from("id,claim,paper,ours,verdict\n");
        for c in &self.claims {
            let fields = [c.id, c.claim, c.paper, &c.ours, c.verdict].map(files::field);
            let _ = writeln!(csv, "{}", fields.join(","));
        }
        fs::write(folder.join("claims.csv"), csv)?;
        fs::write(
            folder.join("index.html"),
            files::page("The paper of 1992, and ours beside it", &self.html(run), self.findings.figures()),
        )?;
        for c in &self.claims {
            println!("{:4} {:60} {}", c.id, c.verdict, c.ours);
        }
        Ok(self.findings.report())
    }

    fn markdown(&self, run: &str) -> String {
        let mut text = format!(
            "# The paper's claims, and ours beside them\n\n{run}\n\n| | claim | the paper | this run | verdict |\n|---|---|---|---|---|\n"
        );
        for c in &self.claims {
            let cell = |text: &str| text.replace('|', "\\|");
            let cells = [c.id, c.claim, c.paper, &c.ours, c.verdict].map(cell);
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text
    }

    fn html(&self, run: &str) -> String {
        let safe = |text: &str| subscripts(&text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;"));
        let mut text = format!(
            "<p>Ohbuchi, Chen &amp; Fuchs (1992). {}</p>\n<table>\n<tr><th></th><th>claim</th><th>the paper</th><th>this run</th><th>verdict</th></tr>\n",
            safe(run)
        );
        for c in &self.claims {
            let cells: Vec<String> =
                [c.id, c.claim, c.paper, &c.ours, c.verdict].iter().map(|t| format!("<td>{}</td>", safe(t))).collect();
            let _ = writeln!(text, "<tr>{}</tr>", cells.concat());
        }
        text + "</table>\n"
    }
}

/// Sets subscripts like the figures.
fn subscripts(text: &str) -> String {
    let mut parts = text.split('_');
    let mut set = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (low, rest) = lettering::subscript(part);
        let _ = write!(set, "<sub>{low}</sub>{rest}");
    }
    set
}
