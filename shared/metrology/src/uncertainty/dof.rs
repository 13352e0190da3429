//! Degrees of freedom (GUM annex G, thesis eq. 4.9).

/// Degrees of freedom of a type B evaluation whose standard uncertainty is itself uncertain by Δu: ν = ½ (Δu/u)⁻²
/// (GUM G.4.2, eq. G.3). A relative uncertainty of 0 gives an infinite ν.
pub fn dof_of_judgement(relative_uncertainty: f64) -> f64 {
    0.5 / (relative_uncertainty * relative_uncertainty)
}

/// Welch–Satterthwaite: ν_eff = u⁴(y) / Σ (u_i⁴(y) / ν_i), contributions u_i(y) = |c_i| u(x_i) that are independent.
///
/// Infinite where no contribution has finite ν_i, and where all are 0. Contributions are scaled by the largest, so that
/// fourth powers neither vanish nor overflow.
pub fn effective_dof(combined: f64, contributions: &[(f64, f64)]) -> f64 {
    let largest = contributions.iter().fold(combined.abs(), |largest, (u, _)| largest.max(u.abs()));
    if largest <= 0.0 {
        return f64::INFINITY;
    }
    let fourth = |u: f64| (u / largest) * (u / largest) * (u / largest) * (u / largest);
    let sum: f64 = contributions.iter().map(|(u, dof)| fourth(*u) / dof).sum();
    fourth(combined) / sum
}
