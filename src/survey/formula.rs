//! Formulas in scanner files.

/// A parsed formula of one variable (spec input-formats §1.6).
#[derive(Clone, Debug)]
pub struct Formula {}
