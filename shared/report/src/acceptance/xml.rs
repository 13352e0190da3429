//! XML documents, element by element.

use super::words::one_line;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event};

/// One line without the signs that XML 1.0 cannot hold.
pub fn clean(text: &str) -> String {
    one_line(text)
        .chars()
        .map(|c| if matches!(c, '\u{fffe}' | '\u{ffff}') { '\u{fffd}' } else { c })
        .collect()
}

/// Elements within elements; all text is escaped.
pub struct Xml(Writer<Vec<u8>>);

impl Xml {
    /// A document with its declaration.
    pub fn document() -> Self {
        let mut xml = Self(Writer::new_with_indent(Vec::new(), b' ', 2));
        xml.event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)));
        xml
    }

    /// The whole document, UTF-8.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0.into_inner()
    }

    /// Writes one event of the document.
    pub fn event(&mut self, event: Event<'_>) {
        // Writing to a Vec cannot fail.
        let _ = self.0.write_event(event);
    }

    /// An element with attributes and what stands in it.
    pub fn within(&mut self, name: &str, attributes: &[(&str, &str)], body: impl FnOnce(&mut Self)) {
        self.event(Event::Start(BytesStart::new(name).with_attributes(attributes.iter().copied())));
        body(self);
        self.event(Event::End(BytesEnd::new(name)));
    }

    /// An element with the number of its members.
    pub fn list(&mut self, name: &str, n: usize, body: impl FnOnce(&mut Self)) {
        self.within(name, &[("n", &n.to_string())], body);
    }

    /// A numbered element, named by its kind and by what it is.
    pub fn element(&mut self, kind: &str, what: &str, id: usize, body: impl FnOnce(&mut Self)) {
        self.within(&format!("{kind}{what}"), &[("id", &id.to_string())], body);
    }

    /// An element that holds a text.
    pub fn leaf(&mut self, name: &str, text: &str) {
        self.within(name, &[], |xml| xml.words(text));
    }

    /// A text by itself.
    pub fn words(&mut self, text: &str) {
        self.event(Event::Text(BytesText::new(&clean(text))));
    }
}
