//! Payloads: a header of four bytes, then XCDR version 1, little-endian.

use crate::error::PublishError;
use byteorder::LittleEndian;
use serde::de::DeserializeOwned;

/// Representation identifier `CDR_LE` and two bytes of options, which are unused.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Appends the payload of a message to `out`.
///
/// # Errors
///
/// [`PublishError::Cdr`] if the message cannot be encoded.
pub fn to_cdr(
    message: &impl crate::ros::RosMessage,
    out: &mut Vec<u8>,
) -> Result<(), PublishError> {
    out.extend_from_slice(&HEADER);
    // alignment counts from the end of the header, as the writer does
    cdr_encoding::to_writer::<_, LittleEndian, _>(out, message).map_err(PublishError::Cdr)
}

/// Reads a message from its payload, which is not trusted.
///
/// # Errors
///
/// [`PublishError::Cdr`] or [`PublishError::CdrHeader`] for bytes that are not such a message.
pub fn from_cdr<M: DeserializeOwned>(payload: &[u8]) -> Result<M, PublishError> {
    let Some((header, body)) = payload.split_first_chunk::<4>() else {
        return Err(PublishError::CdrHeader { bytes: payload.len() });
    };
    // options may hold the number of padding bytes at the end
    if header[..2] != HEADER[..2] {
        return Err(PublishError::CdrHeader { bytes: payload.len() });
    }
    let (message, _) =
        cdr_encoding::from_bytes::<M, LittleEndian>(body).map_err(PublishError::Cdr)?;
    Ok(message)
}
