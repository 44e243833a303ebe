//! Chunks of pulses, the warehouse that holds them, and the threads that empty it.
