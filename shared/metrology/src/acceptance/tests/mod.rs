//! Clouds whose errors are known in closed form, and plans that break rules.

mod attacks;
mod plans;
mod refused;
mod synthetic;
mod values;
