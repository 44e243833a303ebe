//! XML documents as owned elements with their places in the file.

use super::text::{decode, line_of_bytes};
use super::xml_limits::{MAX_NODES, check_limits};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Place};

/// The folder of the built-in files in messages.
pub(super) const BUILT_IN: &str = "<built in>";

/// A parsed document. Elements are stored flat, in document order.
#[derive(Debug)]
pub(super) struct XmlDocument {
    path: PathBuf,
    text: String,
    /// Byte offsets of the line starts.
    lines: Vec<usize>,
    nodes: Vec<Node>,
}

#[derive(Debug)]
struct Node {
    name: String,
    /// Range of the name in the start tag, bytes.
    at: Range<usize>,
    attributes: Vec<Attribute>,
    children: Vec<usize>,
    content: String,
    /// Range of the first text between its children that is not blank, bytes.
    text: Option<Range<usize>>,
}

#[derive(Debug)]
struct Attribute {
    name: String,
    value: String,
    name_at: Range<usize>,
    value_at: Range<usize>,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    document: Arc<XmlDocument>,
    index: usize,
}

impl XmlDocument {
    /// Parses the bytes of `path`; errors are added to `problems`.
    pub fn parse(path: &Path, bytes: &[u8], problems: &mut Diagnostics) -> Option<Arc<XmlDocument>> {
        let text = match decode(bytes) {
            Ok(text) => text,
            Err(e) => {
                let (line, excerpt) = line_of_bytes(bytes, e.at);
                let place = Some(Place::in_line(path, line, &excerpt, 0..0));
                // Binary data is not decoded in a guessed encoding.
                let Some(guess) = e.guess.filter(|_| !bytes.contains(&0)) else {
                    problems.error(place, e.message);
                    return None;
                };
                problems.warn(place, format!("{}; it is read as Windows-1252", e.message));
                guess
            }
        };
        if let Err((at, message)) = check_limits(&text) {
            problems.error(Some(Place::in_text(path, &text, at)), message);
            return None;
        }
        let parsed = without_late_declaration(path, &text, problems);
        let options =
            roxmltree::ParsingOptions { allow_dtd: true, nodes_limit: MAX_NODES, ..Default::default() };
        let tree = match roxmltree::Document::parse_with_options(&parsed, options) {
            Ok(tree) => tree,
            Err(roxmltree::Error::NodesLimitReached) => {
                let message = format!("the document has more than {MAX_NODES} elements, texts and comments");
                problems
                    .error(Some(Place::in_line(path, 0, "", 0..0)), message)
                    .help("a table of instances (.csv) holds more parts than a document");
                return None;
            }
            Err(e) => {
                let at = match e {
                    // These errors have no position.
                    roxmltree::Error::UnexpectedEndOfStream | roxmltree::Error::UnclosedRootNode => {
                        text.trim_end().char_indices().last().map_or(0, |(i, _)| i)
                    }
                    _ => byte_at(&text, e.pos()),
                };
                problems.error(
                    Some(Place::in_text(path, &text, at..at + 1)),
                    format!("not well-formed XML: {e}"),
                );
                return None;
            }
        };
        let nodes = flatten(&tree);
        let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect();
        Some(Arc::new(XmlDocument { path: path.to_path_buf(), text, lines, nodes }))
    }

    pub fn root(self: &Arc<Self>) -> Element {
        Element { document: self.clone(), index: 0 }
    }

    fn place(&self, at: &Range<usize>) -> Place {
        let line = self.lines.partition_point(|&start| start <= at.start).max(1);
        let start = self.lines[line - 1];
        let end = self.lines.get(line).copied().unwrap_or(self.text.len());
        let text = self.text.get(start..end).unwrap_or_default();
        Place::in_line(&self.path, line, text, at.start - start..at.end.min(end) - start)
    }
}

/// The text with blanks in place of an XML declaration that follows blank lines. XML forbids such a
/// declaration, but the reference accepts it; the blanks keep all positions.
fn without_late_declaration<'t>(path: &Path, text: &'t str, problems: &mut Diagnostics) -> Cow<'t, str> {
    let start = text.len() - text.trim_start().len();
    if start == 0 || !text[start..].starts_with("<?xml ") {
        return Cow::Borrowed(text);
    }
    let Some(length) = text[start..].find("?>") else { return Cow::Borrowed(text) };
    let end = start + length + 2;
    let message = "the XML declaration is not at the beginning of the file; what precedes it is skipped";
    problems.warn(Some(Place::in_text(path, text, start..end)), message);
    let blank: String =
        text[start..end].chars().flat_map(|c| std::iter::repeat_n(' ', c.len_utf8())).collect();
    Cow::Owned(format!("{}{blank}{}", &text[..start], &text[end..]))
}

fn flatten(tree: &roxmltree::Document) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::new();
    // Index in `nodes` by tree node; a parent always precedes its children.
    let mut index_of = std::collections::HashMap::new();
    for element in tree.descendants().filter(|n| n.is_element()) {
        let index = nodes.len();
        index_of.insert(element.id(), index);
        if let Some(&parent) = element.parent().and_then(|p| index_of.get(&p.id())) {
            nodes[parent].children.push(index);
        }
        let attributes = element.attributes().map(|a| Attribute {
            name: a.name().to_owned(),
            value: a.value().to_owned(),
            name_at: a.range_qname(),
            value_at: a.range_value(),
        });
        let name = element.tag_name().name();
        let start = element.range().start + 1;
        nodes.push(Node {
            name: name.to_owned(),
            at: start..start + name.len(),
            attributes: attributes.collect(),
            children: Vec::new(),
            content: element.text().unwrap_or_default().to_owned(),
            text: element.children().find_map(visible_text),
        });
    }
    nodes
}

/// The range of a text node without the blanks around it, unless it is blank.
fn visible_text(node: roxmltree::Node) -> Option<Range<usize>> {
    let text = node.text().filter(|text| node.is_text() && !text.trim().is_empty())?;
    let (at, start) = (node.range(), text.len() - text.trim_start().len());
    // Entities make the written text longer than the decoded one.
    let length = text.trim().len().min(at.len().saturating_sub(start));
    Some(at.start + start..at.start + start + length)
}

/// Byte offset of a row and column, both from 1, columns in characters.
fn byte_at(text: &str, pos: roxmltree::TextPos) -> usize {
    let line =
        text.split_inclusive('\n').take((pos.row as usize).saturating_sub(1)).map(str::len).sum::<usize>();
    let rest = &text[line.min(text.len())..];
    line + rest.char_indices().nth((pos.col as usize).saturating_sub(1)).map_or(rest.len(), |(i, _)| i)
}

impl Element {
    fn node(&self) -> &Node {
        &self.document.nodes[self.index]
    }

    pub fn name(&self) -> &str {
        &self.node().name
    }

    /// The file that contains the element.
    pub fn path(&self) -> &Path {
        &self.document.path
    }

    /// The folder of the file that contains the element.
    pub fn folder(&self) -> &Path {
        self.document.path.parent().unwrap_or(Path::new(""))
    }

    /// True if it is in a file of the built-in catalogue.
    pub fn is_built_in(&self) -> bool {
        self.path().starts_with(BUILT_IN)
    }

    pub fn root(&self) -> Element {
        self.document.root()
    }

    /// A key that is unique among the elements of one run.
    pub fn key(&self) -> (PathBuf, usize) {
        (self.document.path.clone(), self.index)
    }

    pub fn children(&self) -> impl Iterator<Item = Element> + '_ {
        self.node().children.iter().map(|&index| Element { document: self.document.clone(), index })
    }

    pub fn named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = Element> + 'a {
        self.children().filter(move |c| c.name() == name)
    }

    pub fn child(&self, name: &str) -> Option<Element> {
        self.children().find(|c| c.name() == name)
    }

    /// The first text between its children that is not blank, as written, and its place.
    pub fn stray_text(&self) -> Option<(&str, Place)> {
        let at = self.node().text.as_ref()?;
        Some((self.document.text.get(at.clone())?, self.document.place(at)))
    }

    /// Text before the first child element.
    pub fn content(&self) -> &str {
        &self.node().content
    }

    pub fn value(&self, name: &str) -> Option<&str> {
        self.attribute(name).map(|a| a.value.as_str())
    }

    pub fn attribute_names(&self) -> impl Iterator<Item = &str> {
        self.node().attributes.iter().map(|a| a.name.as_str())
    }

    fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.node().attributes.iter().find(|a| a.name == name)
    }

    /// The place of the tag.
    pub fn place(&self) -> Place {
        self.document.place(&self.node().at)
    }

    /// The place of an attribute's value, or of the tag if there is no such attribute.
    pub fn value_place(&self, name: &str) -> Place {
        self.document.place(self.attribute(name).map_or(&self.node().at, |a| &a.value_at))
    }

    /// The place of a part of an attribute's value.
    pub fn value_part_place(&self, name: &str, part: &Range<usize>) -> Place {
        let Some(attribute) = self.attribute(name) else { return self.place() };
        let at = &attribute.value_at;
        // entities make the written value longer than the decoded one; then the complete value is marked
        if at.len() != attribute.value.len() {
            return self.document.place(at);
        }
        self.document.place(&(at.start + part.start..at.start + part.end.max(part.start)))
    }

    /// The place of an attribute's name.
    pub fn name_place(&self, name: &str) -> Place {
        self.document.place(self.attribute(name).map_or(&self.node().at, |a| &a.name_at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_render::Render as _;

    fn parse(text: &str) -> Result<Element, String> {
        let mut problems = Diagnostics::default();
        XmlDocument::parse(Path::new("a.xml"), text.as_bytes(), &mut problems)
            .map(|d| d.root())
            .ok_or_else(|| problems.render(false))
    }

    #[test]
    fn elements_know_their_places() {
        let root = parse("\u{feff}<?xml version='1.0'?>\r\n<document>\r\n  <leg z='abc' n=\"a&amp;b\">12</leg>\r\n</document>").unwrap();
        let leg = root.child("leg").unwrap();
        assert_eq!((leg.place().line, leg.place().column), (3, 4));
        let z = leg.value_place("z");
        assert_eq!((z.line, z.column, &z.excerpt[z.marked.clone()]), (3, 11, "abc"));
        assert_eq!((leg.value("n"), leg.content()), (Some("a&b"), "12"));
        assert_eq!(leg.value_part_place("z", &(1..2)).column, 12);
        assert_eq!(root.attribute_names().count(), 0);
    }

    #[test]
    fn declarations_after_blank_lines_are_skipped_with_a_warning() {
        let text = "\n <?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document><leg z='abc'/></document>";
        let mut problems = Diagnostics::default();
        let root = XmlDocument::parse(Path::new("a.xml"), text.as_bytes(), &mut problems).unwrap().root();
        let place = root.child("leg").unwrap().value_place("z");
        assert_eq!((place.line, place.column), (3, 19));
        let report = problems.render(false);
        assert!(report.contains("warning: the XML declaration") && report.contains("a.xml:2:2"), "{report}");
        for wrong in ["\n<?xml version='1.0'", "\n<?xml version='1.0'?>", "x<?xml version='1.0'?><document/>"]
        {
            assert!(parse(wrong).unwrap_err().contains("not well-formed"), "{wrong}");
        }
    }

    #[test]
    fn malformed_documents_are_located() {
        let report = parse("<document>\n  <leg z='1'>\n</document>").unwrap_err();
        assert!(report.contains("not well-formed") && report.contains("a.xml:3:"), "{report}");
        let report = parse("").unwrap_err();
        assert!(report.contains("not well-formed"), "{report}");
        // A truncated document ends where it was truncated.
        for cut in [
            "<document>\n  <leg z='1'/>\n  <sc",
            "<document>\n  <leg z='1'/>\n  é \n\n",
            "<document>\n\n  <!-- é",
        ] {
            let report = parse(cut).unwrap_err();
            assert!(report.contains("a.xml:3:"), "{report}");
        }
    }

    #[test]
    fn hostile_documents_end_in_an_answer() {
        let deep = "<a>".repeat(200_000);
        assert!(parse(&deep).is_err());
        let laughs = "<!DOCTYPE a [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;'>\
                      <!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;'><!ENTITY d '&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;'>\
                      <!ENTITY e '&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;'>]><document x='&e;'/>";
        assert!(parse(laughs).is_err());
    }
}
