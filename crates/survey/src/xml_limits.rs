//! Limits of XML documents, checked before they are parsed: the parser compares each attribute of an element
//! with all others, and expands every reference to an entity.

use memchr::{memchr, memchr2, memchr3, memmem};
use std::collections::HashMap;
use std::ops::Range;

/// Maximum size of a document, bytes.
pub const MAX_DOCUMENT_BYTES: u64 = 1 << 27;
/// Maximum number of elements, texts and comments of a document.
pub(super) const MAX_NODES: u32 = 1 << 22;
/// Maximum number of elements around an element.
const MAX_DEPTH: usize = 100;
/// Maximum number of attributes of an element.
const MAX_ATTRIBUTES: usize = 250;
/// Maximum length of the text of an entity, bytes; it may hold elements whose attributes are not counted.
const MAX_ENTITY_BYTES: usize = 1 << 14;
/// Maximum length of all texts that stand for entities, bytes.
const MAX_EXPANDED_BYTES: u64 = 1 << 20;
/// Depth to which the parser expands entities within entities.
const MAX_ENTITY_DEPTH: usize = 10;

/// A violated limit: the place in the text and the message.
pub(super) type Excess = (Range<usize>, String);

/// Checks depth, attributes and entities of a document. Malformed documents are left to the parser.
pub(super) fn check_limits(text: &str) -> Result<(), Excess> {
    let mut scan = Scan { text: text.as_bytes(), at: 0, depth: 0, entities: HashMap::new(), expanded: 0 };
    scan.document().unwrap_or(Ok(()))
}

struct Scan<'t> {
    text: &'t [u8],
    at: usize,
    depth: usize,
    /// Length of the text of each entity when it is expanded, bytes.
    entities: HashMap<&'t [u8], u64>,
    expanded: u64,
}

impl<'t> Scan<'t> {
    /// `None` where the document ends too early.
    fn document(&mut self) -> Option<Result<(), Excess>> {
        loop {
            self.at += memchr2(b'<', b'&', &self.text[self.at..])?;
            let rest = &self.text[self.at..];
            let checked = if rest[0] == b'&' {
                let checked = self.references(self.at..self.at + 1);
                self.at += 1;
                checked
            } else if rest.starts_with(b"<!--") {
                self.skip_past(b"-->")?;
                Ok(())
            } else if rest.starts_with(b"<![CDATA[") {
                self.skip_past(b"]]>")?;
                Ok(())
            } else if rest.starts_with(b"<?") {
                self.skip_past(b"?>")?;
                Ok(())
            } else if rest.starts_with(b"<!DOCTYPE") {
                self.document_type()?
            } else if rest.starts_with(b"</") {
                self.depth = self.depth.saturating_sub(1);
                self.skip_past(b">")?;
                Ok(())
            } else {
                self.start_tag()?
            };
            if checked.is_err() {
                return Some(checked);
            }
        }
    }

    fn skip_past(&mut self, end: &[u8]) -> Option<()> {
        self.at += memmem::find(&self.text[self.at..], end)? + end.len();
        Some(())
    }

    /// The quoted text whose opening quote is at `quote`.
    fn quoted(&self, quote: usize) -> Option<Range<usize>> {
        let length = memchr(self.text[quote], &self.text[quote + 1..])?;
        Some(quote + 1..quote + 1 + length)
    }

    fn start_tag(&mut self) -> Option<Result<(), Excess>> {
        let start = self.at;
        let mut attributes = 0;
        loop {
            self.at += memchr3(b'"', b'\'', b'>', &self.text[self.at..])?;
            if self.text[self.at] == b'>' {
                break;
            }
            attributes += 1;
            let value = self.quoted(self.at)?;
            self.at = value.end + 1;
            if let Err(excess) = self.references(value) {
                return Some(Err(excess));
            }
        }
        if attributes > MAX_ATTRIBUTES {
            let message =
                format!("an element with {attributes} attributes, expected at most {MAX_ATTRIBUTES}");
            return Some(Err((start..start + 1, message)));
        }
        if self.text[self.at - 1] != b'/' {
            self.depth += 1;
        }
        self.at += 1;
        if self.depth > MAX_DEPTH {
            let message = format!("elements are nested more than {MAX_DEPTH} deep");
            return Some(Err((start..start + 1, message)));
        }
        Some(Ok(()))
    }

    /// Adds the texts of the entities that are named by a reference that begins in `at`.
    fn references(&mut self, at: Range<usize>) -> Result<(), Excess> {
        if self.entities.is_empty() {
            return Ok(());
        }
        let text = self.text;
        for start in memchr::memchr_iter(b'&', &text[at.clone()]).map(|i| at.start + i) {
            let name = &text[start + 1..text.len().min(start + MAX_ENTITY_BYTES)];
            let length = memchr(b';', name).and_then(|end| self.entities.get(&name[..end]));
            self.expanded = self.expanded.saturating_add(length.copied().unwrap_or(0));
            if self.expanded > MAX_EXPANDED_BYTES {
                let message = format!("entities stand for more than {MAX_EXPANDED_BYTES} bytes of text");
                return Err((start..start + 1, message));
            }
        }
        Ok(())
    }

    /// Reads the entities of the document type.
    fn document_type(&mut self) -> Option<Result<(), Excess>> {
        let mut texts: Vec<(&[u8], Range<usize>)> = Vec::new();
        let (mut inside, mut name) = (false, None);
        self.at += 1;
        loop {
            let rest = &self.text[self.at..];
            match *rest.first()? {
                b'"' | b'\'' => {
                    let value = self.quoted(self.at)?;
                    self.at = value.end;
                    if let Some(name) = name.take() {
                        if value.len() > MAX_ENTITY_BYTES {
                            let message = format!(
                                "an entity of {} bytes, expected at most {MAX_ENTITY_BYTES}",
                                value.len()
                            );
                            return Some(Err((value.start..value.start + 1, message)));
                        }
                        texts.push((name, value));
                    }
                }
                b'<' if rest.starts_with(b"<!--") => {
                    self.skip_past(b"-->")?;
                    continue;
                }
                b'<' => {
                    let word = rest.strip_prefix(b"<!ENTITY").map(|r| r.trim_ascii_start());
                    name = word.and_then(|w| Some(&w[..w.iter().position(u8::is_ascii_whitespace)?]));
                }
                b'[' => inside = true,
                b']' => inside = false,
                b'>' if !inside => break,
                _ => {}
            }
            self.at += 1;
        }
        self.at += 1;
        self.expand(&texts);
        Some(Ok(()))
    }

    /// Computes the lengths of entities whose texts name others.
    fn expand(&mut self, texts: &[(&'t [u8], Range<usize>)]) {
        let mut lengths: HashMap<&[u8], u64> = HashMap::new();
        for _ in 0..MAX_ENTITY_DEPTH {
            let before = std::mem::take(&mut lengths);
            for (name, at) in texts {
                let text = &self.text[at.clone()];
                let named = memchr::memchr_iter(b'&', text).filter_map(|start| {
                    let name = &text[start + 1..];
                    before.get(&name[..memchr(b';', name)?]).copied()
                });
                lengths.insert(name, named.fold(text.len() as u64, u64::saturating_add));
            }
            if lengths == before {
                break;
            }
        }
        self.entities = lengths;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn excess(text: &str) -> String {
        check_limits(text).expect_err("a limit is violated").1
    }

    #[test]
    fn ordinary_documents_are_within_the_limits() {
        let entity =
            "<!DOCTYPE d [<!-- '>\" --><!ENTITY p \"data/<b>\">]><d a='&p;x' b='1'>&p;<!-- <e 'x'> --></d>";
        for text in ["", "<", "<a b='", "<d><a/></d>", entity, "<![CDATA[<a>]]>", "<?xml version='1.0'?><a/>"]
        {
            assert_eq!(check_limits(text), Ok(()), "{text}");
        }
        let wide: String = (0..MAX_ATTRIBUTES).map(|i| format!(" a{i}='>'")).collect();
        assert_eq!(check_limits(&format!("<a{wide}/>")), Ok(()));
        assert_eq!(check_limits(&"<a></a>".repeat(1000)), Ok(()));
    }

    #[test]
    fn each_limit_is_named_with_its_place() {
        let wide: String = (0..=MAX_ATTRIBUTES).map(|i| format!(" a{i}='1'")).collect();
        let (at, message) = check_limits(&format!("<d><e{wide}/></d>")).unwrap_err();
        assert_eq!((at, message.as_str()), (3..4, "an element with 251 attributes, expected at most 250"));
        assert!(excess(&"<a>".repeat(MAX_DEPTH + 1)).contains("nested more than 100"));
        let long = format!("<!DOCTYPE a [<!ENTITY a '{}'>]><a/>", "x".repeat(MAX_ENTITY_BYTES + 1));
        assert!(excess(&long).contains("an entity of 16385 bytes"));
        let often =
            format!("<!DOCTYPE a [<!ENTITY a '{}'>]><a>{}</a>", "x".repeat(10_000), "&a;".repeat(105));
        assert!(excess(&often).contains("more than 1048576 bytes"));
        let laughs = "<!DOCTYPE a [<!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;'><!ENTITY a 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaa'>\
                      <!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;'><!ENTITY d '&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;'>]><a x='&d;&d;&d;&d;'/>";
        assert_eq!(check_limits(laughs), Ok(()), "120,000 bytes");
        assert!(excess(&laughs.replace("&d;&d;&d;&d;", &"&d;".repeat(40))).contains("entities stand for"));
        let endless = "<!DOCTYPE a [<!ENTITY a '&b;&b;'><!ENTITY b '&a;&a;aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa'>]><a>&a;</a>";
        assert_eq!(check_limits(endless), Ok(()), "loops are left to the parser");
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_scanned(text in "[<>!?/'\"&;a \\[\\]-]{0,80}|<!DOCTYPE[<>!?/'\"&;a \\[\\]-]{0,80}") {
            let _ = check_limits(&text);
        }
    }
}
