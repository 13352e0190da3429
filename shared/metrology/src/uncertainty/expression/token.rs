//! From text to numbers, names and signs.

use super::ExpressionError;

/// The smallest meaningful pieces.
#[derive(Debug, Clone, PartialEq)]
pub enum Token {
    Number(f64),
    Name(String),
    /// One of `+ - * / ^ ( ) ,`.
    Sign(char),
    End,
}

impl Token {
    /// The token in words, for messages.
    pub fn words(&self) -> String {
        match self {
            Self::Number(value) => format!("number {value}"),
            Self::Name(name) => format!("\"{name}\""),
            Self::Sign(sign) => format!("\"{sign}\""),
            Self::End => "the end".to_owned(),
        }
    }
}

/// A piece and its column, counted from 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    pub token: Token,
    pub column: usize,
}

/// Whether a name may begin with this sign.
pub fn begins_name(sign: char) -> bool {
    sign.is_alphabetic() || sign == '_'
}

/// Whether a name may go on with this sign.
pub fn continues_name(sign: char) -> bool {
    sign.is_alphanumeric() || sign == '_'
}

/// Cuts a formula into pieces; the last one is [`Token::End`].
pub fn tokens(text: &str) -> Result<Vec<Placed>, ExpressionError> {
    let signs: Vec<char> = text.chars().collect();
    let mut placed = Vec::new();
    let mut at = 0;
    while let Some(&sign) = signs.get(at) {
        let column = at + 1;
        if sign.is_whitespace() {
            at += 1;
            continue;
        }
        let length;
        let token = if sign.is_ascii_digit() || sign == '.' {
            length = number_length(&signs[at..]);
            number(&signs[at..at + length], column)?
        } else if begins_name(sign) {
            length = signs[at..].iter().take_while(|s| continues_name(**s)).count();
            Token::Name(signs[at..at + length].iter().collect())
        } else if matches!(sign, '+' | '-' | '*' | '/' | '^' | '(' | ')' | ',') {
            length = 1;
            Token::Sign(sign)
        } else {
            return Err(ExpressionError::Sign { column, sign });
        };
        placed.push(Placed { token, column });
        at += length;
    }
    placed.push(Placed { token: Token::End, column: signs.len() + 1 });
    Ok(placed)
}

/// Digits, a point, and an exponent where digits follow the e.
fn number_length(signs: &[char]) -> usize {
    let digits = |from: usize| signs.iter().skip(from).take_while(|s| s.is_ascii_digit()).count();
    let mut length = digits(0);
    if signs.get(length) == Some(&'.') {
        length += 1 + digits(length + 1);
    }
    if matches!(signs.get(length), Some('e' | 'E')) {
        let sign = usize::from(matches!(signs.get(length + 1), Some('+' | '-')));
        let exponent = digits(length + 1 + sign);
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    length
}

fn number(signs: &[char], column: usize) -> Result<Token, ExpressionError> {
    let text: String = signs.iter().collect();
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(Token::Number(value)),
        _ => Err(ExpressionError::Expected {
            column,
            expected: "a finite number",
            found: format!("\"{text}\""),
        }),
    }
}
