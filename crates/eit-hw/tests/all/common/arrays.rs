//! Files of several arrays: MATLAB's and NumPy's.

use std::io::Write;

use flate2::write::{DeflateEncoder, ZlibEncoder};
use rawzip::{CompressionMethod, ZipArchiveWriter};

/// Class of an array of doubles.
pub const DOUBLE: u32 = 6;
/// Flag of a complex array.
pub const COMPLEX: u32 = 0x800;

/// An element, in the short form if it fits.
pub fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let size = u32::try_from(data.len()).unwrap();
    let head = if data.len() <= 4 {
        ((size << 16) | kind).to_le_bytes().to_vec()
    } else {
        [kind.to_le_bytes(), size.to_le_bytes()].concat()
    };
    let mut bytes = [head, data.to_vec()].concat();
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// An array of this class and flags; the parts are elements.
pub fn matrix(name: &str, class: u32, shape: &[u32], parts: &[Vec<u8>]) -> Vec<u8> {
    let flags = [class.to_le_bytes(), [0; 4]].concat();
    let shape: Vec<u8> = shape.iter().flat_map(|size| size.to_le_bytes()).collect();
    let head = [element(6, &flags), element(5, &shape), element(1, name.as_bytes())];
    let content = [head.concat(), parts.concat()].concat();
    [&14_u32.to_le_bytes()[..], &(content.len() as u32).to_le_bytes(), &content].concat()
}

/// Doubles counting from 0.
pub fn doubles(name: &str, shape: &[u32]) -> Vec<u8> {
    let count = shape.iter().product::<u32>();
    let data: Vec<u8> = (0..count).flat_map(|value| f64::from(value).to_le_bytes()).collect();
    matrix(name, DOUBLE, shape, &[element(9, &data)])
}

pub fn compressed(matrix: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(matrix).unwrap();
    let data = encoder.finish().unwrap();
    [&15_u32.to_le_bytes()[..], &(data.len() as u32).to_le_bytes(), &data].concat()
}

pub fn mat(variables: &[Vec<u8>]) -> Vec<u8> {
    let mut header = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".to_vec();
    header.resize(124, b' ');
    [&header, &b"\0\x01IM"[..], &variables.concat()].concat()
}

pub fn npz(entries: &[(&str, &[u8])], is_packed: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut archive = ZipArchiveWriter::new(&mut bytes);
    for (name, content) in entries {
        let method = if is_packed { CompressionMethod::DEFLATE } else { CompressionMethod::STORE };
        let (mut file, config) = archive.new_file(name).compression_method(method).start().unwrap();
        let descriptor = if is_packed {
            let level = flate2::Compression::best();
            let mut writer = config.wrap(DeflateEncoder::new(&mut file, level));
            writer.write_all(content).unwrap();
            let (encoder, descriptor) = writer.finish().unwrap();
            encoder.finish().unwrap();
            descriptor
        } else {
            let mut writer = config.wrap(&mut file);
            writer.write_all(content).unwrap();
            writer.finish().unwrap().1
        };
        file.finish(descriptor).unwrap();
    }
    archive.finish().unwrap();
    bytes
}

/// An NPY file of doubles counting from 0.
pub fn npy(shape: &str, count: u32) -> Vec<u8> {
    let data: Vec<u8> = (0..count).flat_map(|value| f64::from(value).to_le_bytes()).collect();
    npy_of("<f8", shape, &data)
}

pub fn npy_of(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    npy_bytes(&format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"), data)
}

/// An NPY file of version 1 with this header.
pub fn npy_bytes(header: &str, data: &[u8]) -> Vec<u8> {
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}
