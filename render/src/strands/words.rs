//! Tokens of pbrt's text, read in one pass: quoted strings, brackets and other words; comments are skipped.

/// A token.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Word<'a> {
    Quoted(&'a [u8]),
    Open,
    Close,
    Bare(&'a [u8]),
}

impl Word<'_> {
    /// The token for messages, truncated.
    pub fn shown(&self) -> String {
        match self {
            Word::Quoted(text) | Word::Bare(text) => shown(text),
            Word::Open => "\"[\"".into(),
            Word::Close => "\"]\"".into(),
        }
    }
}

/// A quoted string, truncated for messages.
pub fn shown(text: &[u8]) -> String {
    format!("{:?}", super::words::cut(&String::from_utf8_lossy(text)))
}

/// Position of the reader in a text.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Line of the last token, from 1.
    pub line: usize,
}

impl<'a> Words<'a> {
    pub fn new(bytes: &'a [u8]) -> Words<'a> {
        let mark: &[u8] = b"\xef\xbb\xbf";
        Words { bytes, at: if bytes.starts_with(mark) { mark.len() } else { 0 }, line: 1 }
    }

    /// The next token; `None` at the end. A token never spans lines.
    pub fn next(&mut self) -> Result<Option<Word<'a>>, String> {
        loop {
            match self.bytes.get(self.at) {
                None => return Ok(None),
                Some(b'\n') => {
                    self.line += 1;
                    self.at += 1;
                }
                Some(b) if b.is_ascii_whitespace() => self.at += 1,
                Some(b'#') => self.at = self.until(self.at, |b| b == b'\n' || b == b'\r'),
                Some(_) => break,
            }
        }
        let from = self.at;
        Ok(Some(match self.bytes[from] {
            b'[' => {
                self.at += 1;
                Word::Open
            }
            b']' => {
                self.at += 1;
                Word::Close
            }
            b'"' => {
                let end = self.until(from + 1, |b| b == b'"' || b == b'\n');
                if self.bytes.get(end) != Some(&b'"') {
                    return Err(format!("{} has no closing quote on its line", shown(&self.bytes[from + 1..end])));
                }
                self.at = end + 1;
                Word::Quoted(&self.bytes[from + 1..end])
            }
            _ => {
                self.at = self.until(from, |b| b.is_ascii_whitespace() || b"[]\"#".contains(&b));
                Word::Bare(&self.bytes[from..self.at])
            }
        }))
    }

    /// The next token, without advancing.
    pub fn peek(&self) -> Result<Option<Word<'a>>, String> {
        let mut ahead = *self;
        ahead.next()
    }

    fn until(&self, from: usize, end: impl Fn(u8) -> bool) -> usize {
        self.bytes[from..].iter().position(|b| end(*b)).map_or(self.bytes.len(), |n| from + n)
    }

    /// The quoted string argument of the statement `of`.
    pub fn quoted(&mut self, of: &[u8]) -> Result<&'a [u8], String> {
        match self.next()? {
            Some(Word::Quoted(text)) => Ok(text),
            Some(word) => Err(format!("{} where {} takes a text in quotes", word.shown(), shown(of))),
            None => Err(format!("{} takes a text in quotes", shown(of))),
        }
    }

    /// The `N` numeric arguments of the statement `of`, with or without brackets.
    pub fn numbers<const N: usize>(&mut self, of: &[u8]) -> Result<[f64; N], String> {
        let in_brackets = self.peek()? == Some(Word::Open);
        if in_brackets {
            self.next()?;
        }
        let mut values = [0.0; N];
        for value in &mut values {
            let word = self.next()?.ok_or_else(|| format!("{} takes {N} numbers", shown(of)))?;
            *value = number(&word)
                .ok_or_else(|| format!("{} is no number; {} takes {N} numbers", word.shown(), shown(of)))?;
        }
        if in_brackets && self.next()? != Some(Word::Close) {
            return Err(format!("{} takes {N} numbers in brackets", shown(of)));
        }
        Ok(values)
    }

    /// The values of a parameter: a bracketed list or a single value.
    pub fn values(&mut self, declared: &[u8], values: &mut Vec<Word<'a>>) -> Result<(), String> {
        values.clear();
        match self.next()? {
            Some(Word::Open) => loop {
                match self.next()? {
                    Some(Word::Close) => return Ok(()),
                    Some(Word::Open) | None => return Err(format!("{} has no closing bracket", shown(declared))),
                    Some(word) => values.push(word),
                }
            },
            Some(word @ (Word::Bare(_) | Word::Quoted(_))) => values.push(word),
            _ => return Err(format!("{} has no value", shown(declared))),
        }
        Ok(())
    }

    /// Skips the arguments of a statement: strings, numbers, booleans, and brackets.
    pub fn pass(&mut self) -> Result<(), String> {
        let mut depth = 0u32;
        while let Some(word) = self.peek()? {
            match word {
                Word::Open => depth += 1,
                Word::Close if depth == 0 => return Err("\"]\" without \"[\"".into()),
                Word::Close => depth -= 1,
                Word::Quoted(_) | Word::Bare(b"true" | b"false") => {}
                Word::Bare(_) if depth > 0 => {}
                Word::Bare(_) if number(&word).is_some() => {}
                Word::Bare(_) => return Ok(()),
            }
            self.next()?;
        }
        if depth > 0 { Err("\"[\" without \"]\"".into()) } else { Ok(()) }
    }
}

/// A finite number.
pub fn number(word: &Word<'_>) -> Option<f64> {
    let Word::Bare(text) = word else { return None };
    std::str::from_utf8(text).ok()?.parse().ok().filter(|v: &f64| v.is_finite())
}

/// At most the first 20 characters of a word.
pub(super) fn cut(word: &str) -> String {
    if word.chars().count() <= 20 { word.to_string() } else { word.chars().take(17).chain("...".chars()).collect() }
}
