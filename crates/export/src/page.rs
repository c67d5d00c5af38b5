//! A self-contained page for a browser: text, tables and drawings over an image plane.
//!
//! - [`Page`]: the document.
//! - [`plate`]: positions in a B-mode image: dots, arrows, a colour map.
//! - [`chart`]: a series of numbers, as bars.
//!
//! Most of it is SVG, whose attributes are formatted numbers. maud would only replace `escaped`.

pub mod chart;
pub mod plate;

use std::fmt::Write as _;

use sonoweave_core::NOTICE;

/// Style sheet of a page: one column of text and figures, in the reader's light or dark scheme.
const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c2430;--soft:#5b6675;--line:#d9dee5;--paper:#fff;--card:#f6f8fa;--good:#1a7f4b;--bad:#b42318}\
@media(prefers-color-scheme:dark){:root{--ink:#e6eaf0;--soft:#9aa5b4;--line:#323b48;--paper:#12161c;--card:#1a2029;--good:#4cc38a;--bad:#ff8a7a}}\
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:60rem;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.6rem;margin:0 0 .5rem}h2{font-size:1.15rem;margin:2.2rem 0 .5rem;border-bottom:1px solid var(--line);padding-bottom:.2rem}\
p{margin:.5rem 0}.soft{color:var(--soft)}\
.verdict{padding:.6rem .9rem;border-left:5px solid;background:var(--card);font-weight:600;margin:1rem 0}.good{border-color:var(--good)}.bad{border-color:var(--bad)}\
.scroll{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.7rem 0}th,td{padding:.2rem .8rem .2rem 0;text-align:right;border-bottom:1px solid var(--line)}\
th{font-weight:600;color:var(--soft)}th:first-child,td:first-child{text-align:left}\
figure{margin:1.2rem 0}figure svg{width:100%;height:auto;display:block;background:var(--card)}figcaption{color:var(--soft);font-size:.92rem;margin-top:.4rem}\
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(20rem,1fr));gap:1rem}.pair figure{margin:0}";

/// A page, from top to bottom.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// Creates an empty page.
    pub fn new(title: &str) -> Self {
        Self { title: escaped(title), body: format!("<h1>{}</h1>\n", escaped(title)) }
    }

    /// Begins a section.
    pub fn part(&mut self, heading: &str) {
        self.put(format_args!("<h2>{}</h2>\n", escaped(heading)));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.put(format_args!("<p>{}</p>\n", escaped(text)));
    }

    /// Adds a secondary paragraph.
    pub fn note(&mut self, text: &str) {
        self.put(format_args!("<p class=\"soft\">{}</p>\n", escaped(text)));
    }

    /// Adds a highlighted overall result.
    pub fn verdict(&mut self, good: bool, text: &str) {
        let class = if good { "good" } else { "bad" };
        self.put(format_args!("<p class=\"verdict {class}\">{}</p>\n", escaped(text)));
    }

    /// Adds a table; its first column holds words, the others numbers.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, texts: &mut dyn Iterator<Item = String>| {
            texts.map(|text| format!("<{tag}>{text}</{tag}>")).collect::<String>()
        };
        let head = cells("th", &mut head.iter().map(|text| escaped(text)));
        let rows: String = rows
            .iter()
            .map(|row| format!("<tr>{}</tr>\n", cells("td", &mut row.iter().map(|text| escaped(text)))))
            .collect();
        self.put(format_args!("<div class=\"scroll\"><table>\n<tr>{head}</tr>\n{rows}</table></div>\n"));
    }

    /// Adds a drawing and its caption.
    pub fn figure(&mut self, svg: &str, caption: &str) {
        self.put(format_args!("<figure>{svg}<figcaption>{}</figcaption></figure>\n", escaped(caption)));
    }

    /// Adds drawings side by side if there is room.
    pub fn figures(&mut self, all: &[(String, String)]) {
        self.body.push_str("<div class=\"pair\">\n");
        for (svg, caption) in all {
            self.figure(svg, caption);
        }
        self.body.push_str("</div>\n");
    }

    /// Returns the document.
    pub fn html(&self) -> String {
        let Self { title, body } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}<p class=\"soft\">{NOTICE}</p>\n</body>\n</html>\n"
        )
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.body.write_fmt(text);
    }
}

/// Escapes a text for HTML and SVG.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_text_is_escaped() {
        let mut page = Page::new("a <b> & \"c\"");
        page.part("p");
        page.verdict(true, "<script>");
        page.table(&["wire <1>", "mm"], &[vec!["<i>".into(), "1".into()]]);
        page.figure("<svg/>", "a > b");
        let html = page.html();
        assert!(!html.contains("<script>") && !html.contains("<i>") && !html.contains("<b>"));
        assert!(
            html.contains("a &lt;b&gt; &amp; &quot;c&quot;</h1>")
                && html.contains("<svg/>")
                && html.contains("a &gt; b")
        );
        let body = &html[html.find("<body>").unwrap()..html.find("</html>").unwrap()];
        let document = roxmltree::Document::parse(body);
        assert!(document.is_ok(), "every element is closed: {document:?}");
    }

    #[test]
    fn page_fetches_nothing() {
        let html = Page::new("t").html();
        assert!(!html.contains("http") && !html.contains("src="), "{html}");
    }

    #[test]
    fn page_ends_with_notice() {
        let html = Page::new("t").html();
        assert!(html.ends_with(&format!("<p class=\"soft\">{NOTICE}</p>\n</body>\n</html>\n")), "{html}");
    }
}
