//! The instrument's moving optics: heads and deflectors per step.
