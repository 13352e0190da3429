//! The exchange structure of ISO 10303-21: numbered entities with their parameters.
//!
//! One pass over the bytes, with bounds on the depth of lists; whatever is no entity of a data section is passed over.

use std::collections::BTreeMap;

/// Lists within lists; deeper ones are no CAD.
const DEEPEST: usize = 64;

/// A parameter of an entity.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// Absent (`$`) or derived (`*`).
    Absent,
    /// A number, whole or not.
    Number(f64),
    /// A text in its written form, escapes resolved where they are of Latin or wider letters.
    Text(String),
    /// A word between dots, without them.
    Word(String),
    /// Another entity by its number.
    Ref(u64),
    /// A list of parameters.
    List(Vec<Value>),
    /// A parameter with the name of its type.
    Typed(String, Box<Value>),
}

/// One type of an entity with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Record {
    pub name: String,
    pub params: Vec<Value>,
}

/// The entities of all data sections.
pub(super) type Entities = BTreeMap<u64, Vec<Record>>;

/// What is wrong, and in which line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fault {
    pub line: usize,
    pub message: String,
}

/// Reads all entities of a file.
pub(super) fn parse(bytes: &[u8]) -> Result<Entities, Fault> {
    let mut reader = Reader { bytes, at: 0 };
    reader.parse().map_err(|message| {
        let before = &bytes[..reader.at.min(bytes.len())];
        let line = before.split(|b| *b == b'\n').count();
        Fault { line, message }
    })
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn parse(&mut self) -> Result<Entities, String> {
        let mut entities = Entities::new();
        let mut sections = 0;
        loop {
            self.blank()?;
            let Some(byte) = self.peek() else {
                return Err("ends without END-ISO-10303-21: it is cut off".into());
            };
            if byte == b'#' {
                let id = self.number_of_entity()?;
                self.blank()?;
                self.expect(b'=')?;
                let records = self.entity()?;
                if entities.insert(id, records).is_some() {
                    return Err(format!("#{id} is there twice"));
                }
                continue;
            }
            let word = self.statement()?;
            match word.as_str() {
                "DATA" => sections += 1,
                "END-ISO-10303-21" if sections > 0 => return Ok(entities),
                "END-ISO-10303-21" => return Err("has no DATA section".into()),
                _ => {}
            }
        }
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    /// Passes blanks and comments.
    fn blank(&mut self) -> Result<(), String> {
        loop {
            while self.peek().is_some_and(|b| b.is_ascii_whitespace() || b == 0xef || b == 0xbb || b == 0xbf)
            {
                self.at += 1;
            }
            if !self.bytes[self.at.min(self.bytes.len())..].starts_with(b"/*") {
                return Ok(());
            }
            let rest = &self.bytes[self.at + 2..];
            let end = rest.windows(2).position(|w| w == b"*/").ok_or("a comment does not end")?;
            self.at += end + 4;
        }
    }

    fn expect(&mut self, byte: u8) -> Result<(), String> {
        self.blank()?;
        if self.peek() == Some(byte) {
            self.at += 1;
            return Ok(());
        }
        let found = match self.peek() {
            None => "the end of the file".to_owned(),
            Some(b) if b.is_ascii_graphic() => format!("\"{}\"", b as char),
            Some(b) => format!("byte {b}"),
        };
        Err(format!("{found} where \"{}\" is needed", byte as char))
    }

    fn word(&mut self) -> String {
        let start = self.at;
        while self.peek().is_some_and(|b| b.is_ascii_alphanumeric() || b"_-!".contains(&b)) {
            self.at += 1;
        }
        String::from_utf8_lossy(&self.bytes[start..self.at]).into_owned()
    }

    /// A statement that is no entity, such as of the header; its first word.
    fn statement(&mut self) -> Result<String, String> {
        let word = self.word();
        loop {
            match self.peek() {
                None => return Err("ends without END-ISO-10303-21: it is cut off".into()),
                Some(b';') => {
                    self.at += 1;
                    return Ok(word);
                }
                Some(b'\'') => drop(self.text()?),
                Some(b'/') => {
                    let before = self.at;
                    self.blank()?;
                    self.at = self.at.max(before + 1);
                }
                Some(b'#') if word.is_empty() => return Ok(word),
                Some(_) => self.at += 1,
            }
        }
    }

    fn number_of_entity(&mut self) -> Result<u64, String> {
        self.at += 1;
        let start = self.at;
        while self.peek().is_some_and(|b| b.is_ascii_digit()) {
            self.at += 1;
        }
        let digits = std::str::from_utf8(&self.bytes[start..self.at]).unwrap_or_default();
        digits.parse().map_err(|_| "\"#\" is followed by no number of an entity".to_owned())
    }

    /// One entity after its equals sign: a record, or several in parentheses.
    fn entity(&mut self) -> Result<Vec<Record>, String> {
        self.blank()?;
        let mut records = Vec::new();
        if self.peek() == Some(b'(') {
            self.at += 1;
            loop {
                self.blank()?;
                if self.peek() == Some(b')') {
                    self.at += 1;
                    break;
                }
                records.push(self.record()?);
            }
        } else {
            records.push(self.record()?);
        }
        self.expect(b';')?;
        Ok(records)
    }

    fn record(&mut self) -> Result<Record, String> {
        let name = self.word().to_ascii_uppercase();
        if name.is_empty() {
            return Err("the name of a type is missing".into());
        }
        self.blank()?;
        self.expect(b'(')?;
        Ok(Record { name, params: self.list(DEEPEST)? })
    }

    /// Parameters up to the closing parenthesis.
    fn list(&mut self, depth: usize) -> Result<Vec<Value>, String> {
        let depth = depth.checked_sub(1).ok_or_else(|| format!("lists lie deeper than {DEEPEST}"))?;
        let mut values = Vec::new();
        self.blank()?;
        if self.peek() == Some(b')') {
            self.at += 1;
            return Ok(values);
        }
        loop {
            values.push(self.value(depth)?);
            self.blank()?;
            if self.peek() == Some(b')') {
                self.at += 1;
                return Ok(values);
            }
            self.expect(b',')?;
        }
    }

    fn value(&mut self, depth: usize) -> Result<Value, String> {
        self.blank()?;
        match self.peek() {
            None => Err("ends within an entity: it is cut off".into()),
            Some(b'$' | b'*') => {
                self.at += 1;
                Ok(Value::Absent)
            }
            Some(b'#') => self.number_of_entity().map(Value::Ref),
            Some(b'\'') => self.text().map(Value::Text),
            Some(b'"') => {
                self.at += 1;
                self.until(b'"')?;
                Ok(Value::Absent)
            }
            Some(b'.') if !self.bytes.get(self.at + 1).is_some_and(u8::is_ascii_digit) => {
                self.at += 1;
                self.until(b'.').map(Value::Word)
            }
            Some(b'(') => {
                self.at += 1;
                self.list(depth).map(Value::List)
            }
            Some(b) if b.is_ascii_alphabetic() || b == b'!' => {
                let name = self.word().to_ascii_uppercase();
                self.expect(b'(')?;
                let mut inner = self.list(depth)?;
                let value = if inner.is_empty() { Value::Absent } else { inner.swap_remove(0) };
                Ok(Value::Typed(name, Box::new(value)))
            }
            Some(_) => self.number().map(Value::Number),
        }
    }

    fn until(&mut self, byte: u8) -> Result<String, String> {
        let start = self.at;
        while self.peek().is_some_and(|b| b != byte) {
            self.at += 1;
        }
        let text = String::from_utf8_lossy(&self.bytes[start..self.at]).into_owned();
        self.expect(byte)?;
        Ok(text)
    }

    fn number(&mut self) -> Result<f64, String> {
        let start = self.at;
        while self.peek().is_some_and(|b| b.is_ascii_digit() || b"+-.eE".contains(&b)) {
            self.at += 1;
        }
        let text = std::str::from_utf8(&self.bytes[start..self.at]).unwrap_or_default();
        text.parse().map_err(|_| {
            let shown: String = text.chars().take(24).collect();
            format!("\"{shown}\" is no parameter")
        })
    }

    /// A text between apostrophes; a doubled one stands for itself.
    fn text(&mut self) -> Result<String, String> {
        self.at += 1;
        let mut bytes = Vec::new();
        loop {
            match self.peek() {
                None => return Err("a text does not end: the file is cut off".into()),
                Some(b'\'') if self.bytes.get(self.at + 1) == Some(&b'\'') => {
                    bytes.push(b'\'');
                    self.at += 2;
                }
                Some(b'\'') => {
                    self.at += 1;
                    return Ok(unescaped(&String::from_utf8_lossy(&bytes)));
                }
                Some(b) => {
                    bytes.push(b);
                    self.at += 1;
                }
            }
        }
    }
}

/// Letters beyond ASCII: `\X2\00E7\X0\`, `\X4\…\X0\`, `\X\E7`. Other escapes stay as they are.
fn unescaped(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("\\X") {
        plain.push_str(&rest[..at]);
        rest = &rest[at..];
        let wide = [("\\X2\\", 4), ("\\X4\\", 8)].into_iter().find(|(head, _)| rest.starts_with(head));
        let found = match wide {
            Some((head, digits)) => rest[head.len()..].find("\\X0\\").map(|end| {
                let codes = rest.as_bytes()[head.len()..head.len() + end].chunks(digits);
                let letter = |code: &[u8]| letter(std::str::from_utf8(code).unwrap_or_default());
                (codes.map(letter).collect::<String>(), head.len() + end + 4)
            }),
            None if rest.starts_with("\\X\\") => rest.get(3..5).map(|code| (letter(code).to_string(), 5)),
            None => None,
        };
        let (letters, used) = found.unwrap_or_else(|| ("\\X".to_owned(), 2));
        plain.push_str(&letters);
        rest = &rest[used..];
    }
    plain.push_str(rest);
    plain
}

fn letter(code: &str) -> char {
    u32::from_str_radix(code, 16).ok().and_then(char::from_u32).unwrap_or(char::REPLACEMENT_CHARACTER)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(data: &str) -> String {
        format!(
            "ISO-10303-21;\nHEADER;\nFILE_NAME('a;b','');\nENDSEC;\nDATA;\n{data}\nENDSEC;\nEND-ISO-10303-21;\n"
        )
    }

    #[test]
    fn parameters_of_every_kind_are_read() {
        let text = file(
            "#1=A('it''s',\"0F\",.T.,(1,-2.5E3,.5),$,*,#2,LENGTH_MEASURE(25.4));\n/* #9=B(); */\n\
             #2 = ( NAMED_UNIT(*) SI_UNIT($,.METRE.) );\n#3=C('\\X2\\00E700FC\\X0\\ \\X\\E7 \\X2\\zz');",
        );
        let found = parse(text.as_bytes()).unwrap();
        assert_eq!(found.len(), 3);
        let word = |w: &str| Value::Word(w.into());
        assert_eq!(
            found[&1][0].params,
            [
                Value::Text("it's".into()),
                Value::Absent,
                word("T"),
                Value::List(vec![Value::Number(1.0), Value::Number(-2500.0), Value::Number(0.5)]),
                Value::Absent,
                Value::Absent,
                Value::Ref(2),
                Value::Typed("LENGTH_MEASURE".into(), Box::new(Value::Number(25.4))),
            ]
        );
        assert_eq!(
            found[&2][1],
            Record { name: "SI_UNIT".into(), params: vec![Value::Absent, word("METRE")] }
        );
        assert_eq!(found[&3][0].params, [Value::Text("çü ç \\X2\\zz".into())]);
    }

    #[test]
    fn what_is_damaged_is_told_with_its_line() {
        let deep = format!("#1=A({}", "(".repeat(100_000));
        for (data, line, words) in [
            ("#1=A(1);\n#2=B(", 8, "where \"(\" is needed"),
            ("#1=A(1;", 6, "where \",\" is needed"),
            ("#1=A(1);\n#1=A(2);", 7, "#1 is there twice"),
            ("#=A(1);", 6, "no number"),
            ("#1=(1);", 6, "where \"(\" is needed"),
            ("#1=(;);", 6, "name of a type"),
            ("#99999999999999999999999=A();", 6, "no number"),
            (deep.as_str(), 6, "deeper than 64"),
        ] {
            let fault = parse(file(data).as_bytes()).unwrap_err();
            assert!(fault.message.contains(words), "{data:.40}: {fault:?}");
            assert!(fault.line.abs_diff(line) <= 2, "{data:.40}: {fault:?}");
        }
        let whole = file("#1=A('x',(1,2),#2);");
        for end in 14..whole.len() - 2 {
            assert!(whole.get(..end).is_none_or(|t| parse(t.as_bytes()).is_err()), "cut at {end}");
        }
        assert!(parse(b"ISO-10303-21;HEADER;ENDSEC;END-ISO-10303-21;").unwrap_err().message.contains("DATA"));
    }
}
