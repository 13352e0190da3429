//! Recursive descent from pieces to postfix steps.
//!
//! ```text
//! sum     = product { ("+" | "-") product }
//! product = signed { ("*" | "/") signed }
//! signed  = ("+" | "-") signed | power
//! power   = atom [ "^" signed ]
//! atom    = number | name | name "(" sum { "," sum } ")" | "(" sum ")"
//! ```

use super::function::{self, Callable};
use super::token::{Placed, Token, tokens};
use super::{ExpressionError, MAX_DEPTH, MAX_LENGTH, Step};

/// Name of the constant.
pub const PI: &str = "pi";

/// Steps of a formula, in postfix order.
pub fn parse(text: &str, names: &[&str]) -> Result<Vec<Step>, ExpressionError> {
    if text.trim().is_empty() {
        return Err(ExpressionError::Empty);
    }
    if text.len() > MAX_LENGTH {
        return Err(ExpressionError::TooLarge { what: "long", found: text.len(), limit: MAX_LENGTH });
    }
    let tokens = tokens(text)?;
    let mut parser = Parser { tokens: &tokens, at: 0, names, depth: 0, steps: Vec::new() };
    parser.sum()?;
    match parser.peek() {
        Token::End => Ok(parser.steps),
        _ => Err(parser.expected("an operator or the end")),
    }
}

struct Parser<'a> {
    /// Ends with [`Token::End`], which is never passed.
    tokens: &'a [Placed],
    at: usize,
    names: &'a [&'a str],
    depth: usize,
    steps: Vec<Step>,
}

impl Parser<'_> {
    fn peek(&self) -> &Token {
        self.tokens.get(self.at).map_or(&Token::End, |placed| &placed.token)
    }

    fn column(&self) -> usize {
        self.tokens.get(self.at).map_or(0, |placed| placed.column)
    }

    fn take_sign(&mut self, wanted: &[char]) -> Option<char> {
        match *self.peek() {
            Token::Sign(sign) if wanted.contains(&sign) => {
                self.at += 1;
                Some(sign)
            }
            _ => None,
        }
    }

    fn expected(&self, expected: &'static str) -> ExpressionError {
        ExpressionError::Expected { column: self.column(), expected, found: self.peek().words() }
    }

    /// Every recursion leads through [`signed`](Self::signed), so it alone counts the depth.
    fn deeper(&mut self) -> Result<(), ExpressionError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(ExpressionError::TooLarge { what: "deep", found: self.depth, limit: MAX_DEPTH });
        }
        Ok(())
    }

    fn sum(&mut self) -> Result<(), ExpressionError> {
        self.product()?;
        while let Some(sign) = self.take_sign(&['+', '-']) {
            self.product()?;
            self.steps.push(if sign == '+' { Step::Add } else { Step::Subtract });
        }
        Ok(())
    }

    fn product(&mut self) -> Result<(), ExpressionError> {
        self.signed()?;
        while let Some(sign) = self.take_sign(&['*', '/']) {
            self.signed()?;
            self.steps.push(if sign == '*' { Step::Multiply } else { Step::Divide });
        }
        Ok(())
    }

    fn signed(&mut self) -> Result<(), ExpressionError> {
        self.deeper()?;
        match self.take_sign(&['+', '-']) {
            Some(sign) => {
                self.signed()?;
                if sign == '-' {
                    self.steps.push(Step::Negate);
                }
            }
            None => self.power()?,
        }
        self.depth -= 1;
        Ok(())
    }

    fn power(&mut self) -> Result<(), ExpressionError> {
        self.atom()?;
        if self.take_sign(&['^']).is_some() {
            self.signed()?;
            self.steps.push(Step::Power);
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), ExpressionError> {
        let column = self.column();
        match self.peek().clone() {
            Token::Number(value) => {
                self.at += 1;
                self.steps.push(Step::Constant(value));
                Ok(())
            }
            Token::Name(name) => {
                self.at += 1;
                if self.take_sign(&['(']).is_some() {
                    self.call(&name, column)
                } else {
                    self.name(name, column)
                }
            }
            Token::Sign('(') => {
                self.at += 1;
                self.sum()?;
                self.close()
            }
            _ => Err(self.expected("a number, a name or \"(\"")),
        }
    }

    fn close(&mut self) -> Result<(), ExpressionError> {
        self.take_sign(&[')']).map(|_| ()).ok_or_else(|| self.expected("\")\""))
    }

    fn name(&mut self, name: String, column: usize) -> Result<(), ExpressionError> {
        let step = match self.names.iter().position(|known| *known == name) {
            Some(index) => Step::Quantity(index),
            None if name == PI => Step::Constant(std::f64::consts::PI),
            None => {
                return Err(ExpressionError::UnknownName { column, name, known: self.names.join(", ") });
            }
        };
        self.steps.push(step);
        Ok(())
    }

    fn call(&mut self, name: &str, column: usize) -> Result<(), ExpressionError> {
        let Some(callable) = function::callable(name) else {
            let known = function::names();
            return Err(ExpressionError::UnknownFunction { column, name: name.to_owned(), known });
        };
        let mut found = 1;
        self.sum()?;
        while self.take_sign(&[',']).is_some() {
            self.sum()?;
            found += 1;
        }
        self.close()?;
        if found != callable.arity() {
            let expected = callable.arity();
            return Err(ExpressionError::Arguments { column, name: name.to_owned(), expected, found });
        }
        self.steps.push(match callable {
            Callable::One(function) => Step::Apply(function),
            Callable::Several(builtin) => Step::Call(builtin),
        });
        Ok(())
    }
}
