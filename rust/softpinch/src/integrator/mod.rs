//! How time is stepped: one file a method, each with its tableau and its paper.
//!
//! A new method is one file beside `rk4.rs` and one line in [`METHODS`].

pub mod rk4;

/// The methods there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The classical Runge-Kutta method of order four.
    Rk4,
}

/// The methods by their public names.
pub const METHODS: [(&str, Method); 1] = [("rk4", Method::Rk4)];

impl Method {
    /// Where the method's stability region ends on the negative real axis; `None` where it does not end.
    #[must_use]
    pub fn real_stability_limit(self) -> Option<f64> {
        match self {
            Self::Rk4 => Some(rk4::REAL_STABILITY_LIMIT),
        }
    }
}
