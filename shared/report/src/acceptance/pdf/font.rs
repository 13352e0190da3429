//! Helvetica of every PDF reader: WinAnsi codes and widths (Adobe Font Metrics), so that no font is embedded.

/// Widths of the signs 32 to 126, thousandths of the size.
const REGULAR: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556,
    556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278,
    500, 667, 556, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469,
    556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500,
    278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];

/// The same of Helvetica-Bold.
const BOLD: [u16; 95] = [
    278, 333, 474, 556, 556, 889, 722, 238, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556,
    556, 556, 556, 556, 556, 333, 333, 584, 584, 584, 611, 975, 722, 722, 722, 722, 667, 611, 778, 722, 278,
    556, 722, 611, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 333, 278, 333, 584,
    556, 333, 556, 611, 556, 611, 556, 333, 611, 611, 278, 278, 556, 278, 889, 611, 611, 611, 611, 389, 556,
    333, 611, 556, 778, 556, 556, 500, 389, 280, 389, 584,
];

/// WinAnsi codes 0x80 to 0x9f that are signs.
const HIGH: [(char, u8); 27] = [
    ('€', 0x80),
    ('‚', 0x82),
    ('ƒ', 0x83),
    ('„', 0x84),
    ('…', 0x85),
    ('†', 0x86),
    ('‡', 0x87),
    ('ˆ', 0x88),
    ('‰', 0x89),
    ('Š', 0x8a),
    ('‹', 0x8b),
    ('Œ', 0x8c),
    ('Ž', 0x8e),
    ('‘', 0x91),
    ('’', 0x92),
    ('“', 0x93),
    ('”', 0x94),
    ('•', 0x95),
    ('–', 0x96),
    ('—', 0x97),
    ('˜', 0x98),
    ('™', 0x99),
    ('š', 0x9a),
    ('›', 0x9b),
    ('œ', 0x9c),
    ('ž', 0x9e),
    ('Ÿ', 0x9f),
];

/// WinAnsi bytes of a text; signs that Helvetica has not are written in other letters, or as a question mark.
pub fn encode(text: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len());
    for sign in text.chars() {
        match sign {
            ' '..='~' | '\u{a1}'..='\u{ff}' => bytes.push(u32::from(sign) as u8),
            '\u{a0}' | '\u{2009}' | '\u{202f}' | '\n' | '\t' | '\r' => bytes.push(b' '),
            // As wide as a digit, and higher than the hyphen.
            '−' | '\u{2011}' => bytes.push(0x96),
            '≤' => bytes.extend(b"<="),
            '≥' => bytes.extend(b">="),
            '√' => bytes.extend(b"sqrt"),
            '∞' => bytes.extend(b"inf"),
            'μ' => bytes.push(0xb5),
            'α' => bytes.extend(b"alpha"),
            'σ' => bytes.extend(b"sigma"),
            'Δ' => bytes.extend(b"Delta"),
            'Ⓜ' => bytes.extend(b"(M)"),
            // Symbols of ISO 1101: the name of the characteristic stands beside each.
            '⏤' | '⏥' | '○' | '⌭' | '∥' | '⊥' | '∠' | '⌖' | '◎' | '⌯' | '⌒' | '⌓' | '↗' | '⌰' =>
                {}
            other => bytes.push(HIGH.iter().find(|(high, _)| *high == other).map_or(b'?', |(_, code)| *code)),
        }
    }
    bytes
}

/// Width of encoded text, points.
pub fn width(bytes: &[u8], bold: bool, size: f64) -> f64 {
    let units: u32 = bytes.iter().map(|byte| u32::from(advance(*byte, bold))).sum();
    f64::from(units) * 1e-3 * size
}

fn advance(byte: u8, bold: bool) -> u16 {
    let table = if bold { &BOLD } else { &REGULAR };
    match byte {
        0x20..=0x7e => table.get(usize::from(byte) - 32).copied().unwrap_or(556),
        0x91 | 0x92 | 0xb7 | 0xcc..=0xcf | 0xec..=0xef => 278,
        0x95 => 350,
        0x85 | 0x97 | 0x99 => 1000,
        0xb0 => 400,
        0xb1 | 0xd7 | 0xf7 => 584,
        0xb2 | 0xb3 | 0xb9 => 333,
        0xc0..=0xdf => 722,
        _ if bold => 611,
        _ => 556,
    }
}

/// Lines of at most `widest` points; a word longer than a line is cut.
pub fn wrap(text: &str, bold: bool, size: f64, widest: f64) -> Vec<Vec<u8>> {
    let mut lines = Vec::new();
    let mut line: Vec<u8> = Vec::new();
    for word in encode(text).split(|byte| *byte == b' ').filter(|word| !word.is_empty()) {
        let space = usize::from(!line.is_empty());
        let longer = [&line[..], &b" "[..space], word].concat();
        if width(&longer, bold, size) <= widest {
            line = longer;
            continue;
        }
        if !line.is_empty() {
            lines.push(std::mem::take(&mut line));
        }
        for byte in word {
            line.push(*byte);
            if width(&line, bold, size) > widest && line.len() > 1 {
                line.pop();
                lines.push(std::mem::replace(&mut line, vec![*byte]));
            }
        }
    }
    if !line.is_empty() || lines.is_empty() {
        lines.push(line);
    }
    lines
}
