//! Tokens of Rust, as far as the checks need them. Comments are tokens, too.

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `//` to the end of its line, or `/*` with the comments nested in it.
    Comment,
    /// An identifier or a keyword.
    Word,
    /// A string, a character, a number or a lifetime.
    Literal,
    /// Any other single character.
    Sign,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Token<'a> {
    pub(crate) kind: Kind,
    pub(crate) text: &'a str,
    /// Line of its first character, from 1.
    pub(crate) line: usize,
}

impl Token<'_> {
    pub(crate) fn is(&self, text: &str) -> bool {
        self.text == text && matches!(self.kind, Kind::Word | Kind::Sign)
    }

    pub(crate) fn is_word(&self) -> bool {
        self.kind == Kind::Word
    }
}

/// Returns all tokens of a file. Unfinished tokens reach to the end of the file.
pub(crate) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut all = Vec::new();
    let mut line = 1;
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        if first.is_whitespace() {
            line += usize::from(first == '\n');
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let (kind, length) = token(rest);
        let (text, after) = rest.split_at(length);
        all.push(Token { kind, text, line });
        line += text.matches('\n').count();
        rest = after;
    }
    all
}

/// Returns kind and length in bytes of the token that a text begins with.
fn token(text: &str) -> (Kind, usize) {
    if text.starts_with("//") {
        return (Kind::Comment, text.find('\n').unwrap_or(text.len()));
    }
    if text.starts_with("/*") {
        return (Kind::Comment, block_comment(text));
    }
    let literal = raw_string(text).or_else(|| string(text)).or_else(|| character(text)).or_else(|| lifetime(text));
    if let Some(length) = literal {
        return (Kind::Literal, length);
    }
    let prefix = if text.starts_with("r#") { 2 } else { 0 };
    let word = word_length(&text[prefix..]);
    if word > 0 {
        return (Kind::Word, prefix + word);
    }
    if text.starts_with(|c: char| c.is_ascii_digit()) {
        return (Kind::Literal, number(text));
    }
    (Kind::Sign, text.chars().next().map_or(0, char::len_utf8))
}

fn block_comment(text: &str) -> usize {
    let mut depth = 0_usize;
    let mut at = 0;
    loop {
        let rest = &text[at..];
        if rest.starts_with("/*") {
            depth += 1;
            at += 2;
        } else if rest.starts_with("*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            match rest.chars().next() {
                Some(c) => at += c.len_utf8(),
                None => return at,
            }
        }
    }
}

fn raw_string(text: &str) -> Option<usize> {
    let prefix = usize::from(text.starts_with(['b', 'c']));
    let rest = text[prefix..].strip_prefix('r')?;
    let hashes = rest.len() - rest.trim_start_matches('#').len();
    let body = rest[hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    let begin = text.len() - body.len();
    Some(body.find(&end).map_or(text.len(), |at| begin + at + end.len()))
}

fn string(text: &str) -> Option<usize> {
    let prefix = usize::from(text.starts_with(['b', 'c']));
    let body = text[prefix..].strip_prefix('"')?;
    let mut escaped = false;
    for (at, c) in body.char_indices() {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return Some(prefix + 1 + at + 1),
            _ => {}
        }
    }
    Some(text.len())
}

/// Returns the length of a character literal; `'a` without a second quote is a lifetime.
fn character(text: &str) -> Option<usize> {
    let prefix = usize::from(text.starts_with('b'));
    let body = text[prefix..].strip_prefix('\'')?;
    let begin = prefix + 1;
    let first = body.chars().next()?;
    if first == '\\' {
        let escaped = body[1..].chars().next()?.len_utf8();
        let end = body[1 + escaped..].find('\'')?;
        return Some(begin + 1 + escaped + end + 1);
    }
    let length = first.len_utf8();
    (first != '\'' && body[length..].starts_with('\'')).then_some(begin + length + 1)
}

fn lifetime(text: &str) -> Option<usize> {
    let length = word_length(text.strip_prefix('\'')?);
    (length > 0).then_some(1 + length)
}

/// Returns the length of a number, of which `1..2` has two and `1.5` one.
fn number(text: &str) -> usize {
    let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_').len();
    let whole = digits(text);
    match text[whole..].strip_prefix('.') {
        Some(part) if part.starts_with(|c: char| c.is_ascii_digit()) => whole + 1 + digits(part),
        _ => whole,
    }
}

fn word_length(text: &str) -> usize {
    if !text.starts_with(|c: char| c.is_alphabetic() || c == '_') {
        return 0;
    }
    text.len() - text.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_').len()
}

#[test]
fn lexer_tells_comments_from_literals() {
    let text = concat!(
        "let a: &'a str = \"// no \\\" comment\"; // one\n",
        "/* two /* nested */ still */ let b = r#\"/* \" raw\"#;\n",
        "let c = ['\"', '\\'', '/', b'\\\\', '\\u{2f}']; // three\n",
        "let r#type = br\"\\\"; let 'x': loop { break 'x } 1..2 // four\n",
    );
    let comments: Vec<(usize, &str)> =
        tokens(text).iter().filter(|t| t.kind == Kind::Comment).map(|t| (t.line, t.text)).collect();
    assert_eq!(comments, [(1, "// one"), (2, "/* two /* nested */ still */"), (3, "// three"), (4, "// four")]);
}

#[test]
fn lexer_returns_whole_text() {
    let text = "fn f<'a>(x: &'a str)->char{'\u{e4}'}/* unfinished /* */";
    let all: String = tokens(text).iter().map(|t| t.text).filter(|t| *t != "fn").collect();
    assert_eq!(all, text.replace("fn f", "f").replace(": &'a str", ":&'astr"));
}
