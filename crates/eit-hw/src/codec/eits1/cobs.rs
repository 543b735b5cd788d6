//! Consistent overhead byte stuffing (Cheshire and Baker 1999): encodes bytes without zeros.

/// Returns the maximum encoded length of `length` bytes.
pub(super) const fn longest(length: usize) -> usize {
    length + length / 254 + 1
}

/// Appends the encoding of `bytes` to `code`, without the final zero.
pub(super) fn encode(bytes: &[u8], code: &mut Vec<u8>) {
    let mut head = code.len();
    code.push(1);
    for &byte in bytes {
        if code[head] == 0xFF {
            head = code.len();
            code.push(1);
        }
        if byte == 0 {
            head = code.len();
            code.push(1);
        } else {
            code.push(byte);
            code[head] += 1;
        }
    }
}

/// Decodes in place bytes that contain no zero; returns the decoded length, or `None` if truncated.
pub(super) fn decode_in_place(code: &mut [u8]) -> Option<usize> {
    let (mut read, mut written) = (0, 0);
    while read < code.len() {
        let run = usize::from(code[read]);
        if run == 0 || read + run > code.len() {
            return None;
        }
        code.copy_within(read + 1..read + run, written);
        written += run - 1;
        read += run;
        if run < 0xFF && read < code.len() {
            code[written] = 0;
            written += 1;
        }
    }
    Some(written)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_vectors() {
        let run: Vec<u8> = (1..=255).collect();
        let mut long = vec![0xFF];
        long.extend(&run[..254]);
        let mut longer = long.clone();
        longer.extend([0x02, 0xFF]);
        let vectors: [(&[u8], &[u8]); 6] = [
            (&[], &[1]),
            (&[0], &[1, 1]),
            (&[0x11, 0, 0x22, 0], &[2, 0x11, 2, 0x22, 1]),
            (&[0x11, 0x22, 0x33], &[4, 0x11, 0x22, 0x33]),
            (&run[..254], &long),
            (&run, &longer),
        ];
        for (bytes, wanted) in vectors {
            let mut code = Vec::new();
            encode(bytes, &mut code);
            assert_eq!(code, wanted);
        }
    }

    proptest! {
        #![proptest_config(fixtures::cases(256))]

        #[test]
        fn round_trip(bytes in prop::collection::vec(prop_oneof![Just(0), any::<u8>()], 0..1200)) {
            let mut code = Vec::new();
            encode(&bytes, &mut code);
            prop_assert!(!code.contains(&0) && code.len() <= longest(bytes.len()));
            let length = decode_in_place(&mut code);
            prop_assert_eq!(length, Some(bytes.len()));
            prop_assert_eq!(&code[..bytes.len()], &bytes[..]);
        }
    }
}
