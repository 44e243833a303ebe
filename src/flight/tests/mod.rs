//! Whole flights.

mod corrected;
mod golden;
mod replay;
mod reported;
