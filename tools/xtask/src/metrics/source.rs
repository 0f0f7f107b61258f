//! One Rust file as counts: which lines are code, comment or documentation, and its code without its tests.
//!
//! A small lexer, no parser: comments, strings and character literals are all that can hide a brace from it.

use std::ops::AddAssign;

/// Lines by what they are for.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lines {
    pub(super) all: usize,
    pub(super) code: usize,
    /// Lines with a `//` comment, beside code or alone.
    pub(super) comment: usize,
    /// `///` and `//!`.
    pub(super) doc: usize,
}

impl AddAssign for Lines {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.code += other.code;
        self.comment += other.comment;
        self.doc += other.doc;
    }
}

/// A file, split into product code and the tests within it.
pub(super) struct Source {
    /// Without comments, contents of strings, and what `cfg(test)` hides.
    pub(super) code: String,
    pub(super) product: Lines,
    pub(super) tests: Lines,
    /// Modules in files of their own that only tests see.
    pub(super) test_modules: Vec<String>,
}

impl Source {
    pub(super) fn read(text: &str) -> Self {
        let (mut code, comments, docs) = blank(text);
        let mut test_modules = Vec::new();
        let mut hidden = Vec::new();
        while let Some(range) = next_test_item(&code) {
            let item = code[range.clone()].trim_end();
            if let Some((_, name)) = item.trim_end_matches(';').rsplit_once("mod ")
                && item.ends_with(';')
            {
                test_modules.push(name.trim().to_owned());
            }
            let first = text[..range.start].matches('\n').count();
            hidden.push(first..first + text[range.clone()].matches('\n').count() + 1);
            let blanked: String = code[range.clone()]
                .chars()
                .map(|c| if c == '\n' { c } else { ' ' })
                .collect();
            code.replace_range(range, &blanked);
        }
        let with_tests = blank(text).0;
        let (mut product, mut tests) = (Lines::default(), Lines::default());
        for (number, line) in with_tests.lines().enumerate() {
            let of = hidden.iter().any(|lines| lines.contains(&number));
            *(if of { &mut tests } else { &mut product }) += Lines {
                all: 1,
                code: usize::from(!line.trim().is_empty()),
                comment: usize::from(comments.contains(&number)),
                doc: usize::from(docs.contains(&number)),
            };
        }
        Self {
            code,
            product,
            tests,
            test_modules,
        }
    }
}

/// The bytes of the next item below an attribute `cfg(test)`, the attribute too.
fn next_test_item(code: &str) -> Option<std::ops::Range<usize>> {
    let mut from = 0;
    loop {
        let start = from + code[from..].find("#[cfg(")?;
        let end = start + code[start..].find(']')?;
        from = end + 1;
        let condition = &code[start..end];
        if !condition.contains("test") || condition.contains("not(") {
            continue;
        }
        let mut depth = 0;
        for (at, c) in code[from..].char_indices() {
            depth += match c {
                '{' | '(' | '[' => 1,
                '}' | ')' | ']' => -1,
                _ => 0,
            };
            if depth == 0 && matches!(c, ';' | '}') || depth < 0 {
                return Some(start..from + at + 1);
            }
        }
        return Some(start..code.len());
    }
}

/// Code of the same length and lines in ASCII, with comments as spaces and strings as quotes; then the lines with
/// comments, and those with documentation.
fn blank(text: &str) -> (String, Vec<usize>, Vec<usize>) {
    let mut out = text.as_bytes().to_vec();
    let (mut comments, mut docs) = (Vec::new(), Vec::new());
    let mut at = 0;
    let mut line = 0;
    while at < out.len() {
        let rest = &text.as_bytes()[at..];
        let end = match rest {
            [b'/', b'/', ..] => {
                let end = at + rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
                let doc = rest.starts_with(b"//!") || rest.starts_with(b"///");
                (if doc { &mut docs } else { &mut comments }).push(line);
                out[at..end].fill(b' ');
                end
            }
            [b'/', b'*', ..] => {
                let end = text[at..].find("*/").map_or(text.len(), |n| at + n + 2);
                comments.extend(line..=line + text[at..end].matches('\n').count());
                fill(&mut out[at..end], b' ');
                end
            }
            [b'"', ..] => at + string(&mut out[at..]),
            [b'r', b'"' | b'#', ..] if at == 0 || !is_name(out[at - 1]) || out[at - 1] == b'b' => {
                at + raw_string(&mut out[at..])
            }
            [b'\'', b'\\', _, tail @ ..] => {
                let end = at + 4 + tail.iter().position(|b| *b == b'\'').unwrap_or(0);
                out[at..end].fill(b'\'');
                end
            }
            [b'\'', tail @ ..] => {
                // One character and a quote; otherwise a lifetime.
                let width = std::str::from_utf8(&tail[..tail.len().min(4)])
                    .or_else(|e| std::str::from_utf8(&tail[..e.valid_up_to()]))
                    .ok()
                    .and_then(|s| s.chars().next())
                    .map_or(1, char::len_utf8);
                let end = at
                    + 1
                    + if tail.get(width) == Some(&b'\'') {
                        width + 1
                    } else {
                        0
                    };
                out[at..end].fill(b'\'');
                end
            }
            _ => at + 1,
        };
        line += text.as_bytes()[at..end]
            .iter()
            .filter(|b| **b == b'\n')
            .count();
        at = end;
    }
    let ascii = out
        .iter()
        .map(|b| if b.is_ascii() { char::from(*b) } else { '?' });
    (ascii.collect(), comments, docs)
}

fn is_name(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

fn fill(bytes: &mut [u8], with: u8) {
    for byte in bytes.iter_mut().filter(|byte| !byte.is_ascii_whitespace()) {
        *byte = with;
    }
}

fn string(bytes: &mut [u8]) -> usize {
    let mut at = 1;
    while at < bytes.len() && bytes[at] != b'"' {
        at += if bytes[at] == b'\\' { 2 } else { 1 };
    }
    let end = (at + 1).min(bytes.len());
    fill(&mut bytes[..end], b'"');
    end
}

/// `r"..."`, `r#"..."#`; a raw identifier such as `r#gen` is left alone.
fn raw_string(bytes: &mut [u8]) -> usize {
    let hashes = bytes[1..].iter().take_while(|b| **b == b'#').count();
    if bytes.get(1 + hashes) != Some(&b'"') {
        fill(&mut bytes[..1 + hashes], b' ');
        return 1 + hashes;
    }
    let close = [b"\"".as_slice(), &vec![b'#'; hashes]].concat();
    let from = 2 + hashes;
    let end = bytes[from..]
        .windows(close.len())
        .position(|window| window == close)
        .map_or(bytes.len(), |n| from + n + close.len());
    fill(&mut bytes[..end], b'"');
    end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_comments_and_strings_are_no_product_code() {
        let text = "//! Doc.\nfn a() { // why\n  b(\"} // no\", '{', '\\'', r#\"\n\"}\"#);\n}\n\n#[cfg(test)]\nmod tests {\n  fn c<'a>() {}\n}\n#[cfg(test)]\nmod apart;\nfn d() {}\n";
        let source = Source::read(text);
        assert_eq!(
            (
                source.product.code,
                source.product.doc,
                source.product.comment
            ),
            (5, 1, 1)
        );
        assert_eq!(source.tests.code, 6);
        assert_eq!(source.test_modules, ["apart"]);
        assert!(source.code.contains("fn d()") && !source.code.contains("fn c"));
    }
}
