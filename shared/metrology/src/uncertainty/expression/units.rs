//! Units of a formula: what is added, subtracted or returned must be of one unit.

use super::function::Builtin;
use super::{Expression, Step};

/// The unit of an intermediate result; `None` where it cannot be determined: constants, products, functions.
type Unit<'a> = Option<&'a str>;

impl Expression {
    /// Whether the sums of the formula are of one unit each and the whole has the unit of the measurand, for quantities of these
    /// units. Products and functions may have any unit.
    ///
    /// # Errors
    /// The first two units that are added, or returned for one another.
    pub fn check_units(&self, units: &[&str], measurand: &str) -> Result<(), [String; 2]> {
        let mut stack: Vec<Unit<'_>> = Vec::new();
        for step in &self.steps {
            let result = match step {
                Step::Constant(_) => None,
                Step::Quantity(index) => units.get(*index).map(|unit| plain(unit)),
                Step::Negate => stack.pop().flatten(),
                Step::Apply(_) => stack.pop().and(None),
                Step::Add | Step::Subtract => {
                    let (second, first) = (stack.pop().flatten(), stack.pop().flatten());
                    together(first, second)?
                }
                Step::Multiply | Step::Divide | Step::Power => {
                    stack.pop();
                    stack.pop().and(None)
                }
                Step::Call(builtin) => {
                    let arguments = stack.split_off(stack.len().saturating_sub(builtin.arity()));
                    call(*builtin, &arguments)?
                }
            };
            stack.push(result);
        }
        together(stack.pop().flatten(), Some(plain(measurand))).map(|_| ())
    }
}

fn together<'a>(first: Unit<'a>, second: Unit<'a>) -> Result<Unit<'a>, [String; 2]> {
    match (first, second) {
        (Some(a), Some(b)) if a != b => Err([a.to_owned(), b.to_owned()]),
        _ => Ok(first.or(second)),
    }
}

/// A length at 20 °C is a length; coordinates of a distance or an angle are of one unit.
fn call<'a>(builtin: Builtin, arguments: &[Unit<'a>]) -> Result<Unit<'a>, [String; 2]> {
    match builtin {
        Builtin::LengthAt20 => Ok(arguments.first().copied().flatten()),
        Builtin::Distance | Builtin::DirectionCosine | Builtin::PlaneAngle | Builtin::Atan2 => {
            let unit = arguments.iter().try_fold(None, |so_far, unit| together(so_far, *unit))?;
            Ok(unit.filter(|_| matches!(builtin, Builtin::Distance)))
        }
    }
}

/// Whether two units are the same one, however they are spelled.
pub fn same_unit(one: &str, other: &str) -> bool {
    plain(one) == plain(other)
}

/// One spelling for each unit.
fn plain(unit: &str) -> &str {
    match unit.trim() {
        "µm" | "μm" | "micron" => "um",
        "°" | "degree" | "degrees" => "deg",
        "C" | "degC" => "°C",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_of_one_unit() {
        let check = |text: &str| {
            Expression::parse(text, &["L", "d", "a", "t"])
                .unwrap()
                .check_units(&["mm", "µm", "1/K", "K"], "mm")
        };
        assert_eq!(check("L + d").unwrap_err(), ["mm", "um"]);
        assert_eq!(check("d").unwrap_err(), ["um", "mm"]);
        assert_eq!(check("length_at_20(L + d, a, t)").unwrap_err(), ["mm", "um"]);
        assert_eq!(check("distance(L, 0, 0, d, 0, 0)").unwrap_err(), ["mm", "um"]);
        assert_eq!(check("-(L - t)").unwrap_err(), ["mm", "K"]);
        for sound in
            ["L + 0.001 * d", "L * (1 + a * t) + 2", "length_at_20(L, a, t)", "sqrt(L * d)", "L + d / 1000"]
        {
            assert_eq!(check(sound), Ok(()), "{sound}");
        }
    }
}
