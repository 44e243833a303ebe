//! The compressions of bytes that TIFF files have. Each function unpacks at most a number of bytes, fewer if
//! the data end before.

use super::error::UnpackError;
use flate2::read::ZlibDecoder;
use std::io::Read;
use vlscan_base::damage::catch_decoder_panic;
use weezl::{BitOrder, LzwStatus};

/// Unpacks Deflate, at most `length` bytes.
pub(super) fn inflate(data: &[u8], length: usize) -> Result<Vec<u8>, UnpackError> {
    let mut bytes = Vec::with_capacity(length.min(data.len().saturating_mul(8)));
    ZlibDecoder::new(data).take(length as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Unpacks Zstandard, at most `length` bytes.
pub(super) fn unzstd(data: &[u8], length: usize) -> Result<Vec<u8>, UnpackError> {
    let unpacked = catch_decoder_panic(|| {
        let mut bytes = Vec::with_capacity(length.min(data.len().saturating_mul(8)));
        let decoder = ruzstd::decoding::StreamingDecoder::new(data).map_err(UnpackError::of_decoder)?;
        decoder.take(length as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    });
    unpacked.unwrap_or(Err(UnpackError::Damaged))
}

/// Unpacks LZW, also of files whose codes begin with their last bit, as they did before TIFF 6.0.
pub(super) fn unlzw(data: &[u8], length: usize) -> Result<Vec<u8>, UnpackError> {
    let is_old = matches!(data, [0, second, ..] if second & 1 == 1);
    let mut decoder = match is_old {
        true => weezl::decode::Decoder::new(BitOrder::Lsb, 8),
        false => weezl::decode::Decoder::with_tiff_size_switch(BitOrder::Msb, 8),
    };
    let (mut bytes, mut read, mut written) = (vec![0; length], 0, 0);
    while written < length {
        let step = decoder.decode_bytes(&data[read..], &mut bytes[written..]);
        (read, written) = (read + step.consumed_in, written + step.consumed_out);
        match step.status {
            Ok(LzwStatus::Ok) => {}
            Ok(LzwStatus::Done | LzwStatus::NoProgress) => break,
            Err(e) => return Err(UnpackError::of_decoder(e)),
        }
    }
    bytes.truncate(written);
    Ok(bytes)
}

/// Unpacks runs and literals (TIFF 6.0, section 9), at most `length` bytes.
pub(super) fn unpack_bits(mut data: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(length.min(data.len().saturating_mul(8)));
    while let [count, rest @ ..] = data
        && bytes.len() < length
    {
        let count = *count as i8;
        data = match (count, rest) {
            (0.., _) => {
                let (literal, rest) = rest.split_at((count as usize + 1).min(rest.len()));
                bytes.extend(literal);
                rest
            }
            (-128, _) | (_, []) => rest,
            (_, [repeated, rest @ ..]) => {
                bytes.resize(bytes.len() + (1 - isize::from(count)) as usize, *repeated);
                rest
            }
        };
    }
    bytes.truncate(length);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_bits_are_runs_and_literals() {
        // The example of TIFF 6.0, section 9.
        let packed = [0xfe, 0xaa, 2, 0x80, 0, 0x2a, 0xfd, 0xaa, 3, 0x80, 0, 0x2a, 0x22, 0xf7, 0xaa];
        let expected: Vec<u8> =
            [&[0xaa; 3][..], &[0x80, 0, 0x2a], &[0xaa; 4], &[0x80, 0, 0x2a, 0x22], &[0xaa; 10]].concat();
        assert_eq!(unpack_bits(&packed, 100), expected);
        assert_eq!(unpack_bits(&[0x80, 5, 1], 9), [1]);
        assert!(unpack_bits(&[0xfe], 9).is_empty());
    }

    #[test]
    fn lzw_is_read_in_both_bit_orders() {
        let text: Vec<u8> = (0..5000u32).map(|i| (i * i / 7 % 11) as u8).collect();
        let new = weezl::encode::Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(&text).unwrap();
        let old = weezl::encode::Encoder::new(BitOrder::Lsb, 8).encode(&text).unwrap();
        for packed in [new, old] {
            assert_eq!(unlzw(&packed, text.len()).unwrap(), text);
            assert!(unlzw(&packed[..packed.len() / 2], text.len()).unwrap().len() < text.len());
        }
    }
}
