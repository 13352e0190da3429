//! The sheet that the parts of the report write on.

use std::fmt::{self, Display, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Text from outside, escaped for elements and attributes.
pub struct Text<'a>(pub &'a str);

impl Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for sign in self.0.chars() {
            match sign {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                // HTML allows no other control characters, such as a terminal's escape codes.
                '\n' | '\t' => f.write_char(sign)?,
                control if control.is_control() => f.write_char('\u{fffd}')?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

/// A PNG as the address of an image.
pub fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

/// The growing text of an HTML page or of a drawing.
pub struct Page {
    html: String,
    ids: usize,
}

impl Page {
    /// Begins a page with head and style.
    pub fn begin(title: &str) -> Self {
        let mut page = Self { html: String::with_capacity(1 << 20), ids: 0 };
        page.put(format_args!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
             style-src 'unsafe-inline'\">\n\
             <title>{}</title>\n<style>{}</style>\n</head>\n<body>\n<main>\n",
            Text(title),
            include_str!("style.css")
        ));
        page
    }

    /// Begins a text without the frame of an HTML page.
    pub(crate) fn fragment() -> Self {
        Self { html: String::new(), ids: 0 }
    }

    /// The text of a fragment as it stands.
    pub(crate) fn into_text(self) -> String {
        self.html
    }

    /// Appends HTML to the page.
    pub fn put(&mut self, html: fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = self.html.write_fmt(html);
    }

    /// Opens a section with its heading.
    pub fn section(&mut self, heading: &str) {
        self.put(format_args!("<section>\n<h2>{}</h2>\n", Text(heading)));
    }

    /// Closes the open section.
    pub fn end_section(&mut self) {
        self.put(format_args!("</section>\n"));
    }

    /// A paragraph in small print.
    pub fn small(&mut self, text: &str) {
        if !text.is_empty() {
            self.put(format_args!("<p class=\"small\">{}</p>\n", Text(text)));
        }
    }

    /// A name that no other element of the page has.
    pub fn fresh_id(&mut self) -> String {
        self.ids += 1;
        format!("id{}", self.ids)
    }

    /// Foot; the whole text.
    pub fn end(mut self) -> String {
        self.html.push_str("</main>\n</body>\n</html>\n");
        self.html
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_leave_its_place() {
        let shown = Text("<script>\"a\"&'b'</script>\u{1b}[31m").to_string();
        assert_eq!(shown, "&lt;script&gt;&quot;a&quot;&amp;&#39;b&#39;&lt;/script&gt;\u{fffd}[31m");
    }
}
