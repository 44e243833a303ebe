//! Checksums of the heights of rasters.

use vlscan_base::store::Checksum;
use vlscan_trace::Heights;

/// Adds the heights of a field.
pub(crate) fn add_heights(sum: &mut Checksum, heights: &Heights) {
    match heights {
        Heights::Short { base, values } => {
            sum.debug(base);
            sum.array(values);
        }
        Heights::Single(values) => sum.array(values),
        Heights::Double(values) => sum.array(values),
    }
}
