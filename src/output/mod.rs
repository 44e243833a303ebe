//! Where the points go: one file per format, all of them taking batches in chunk order.
