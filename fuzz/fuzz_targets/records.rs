//! Headers of a recording's records: the input is a list of commands that build a container with
//! valid and invalid lengths, checksums and nesting, which random bytes hardly ever hit.
#![no_main]

use eit_hw::capture::{CaptureReader, MAGIC, parse};
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;
use std::path::Path;

const TOPICS: [&str; 6] =
    ["/eit/session", "/eit/frame", "/eit/reference", "/eit/touches", "/eit/note", "/other"];

/// Takes numbers and strings from the input.
struct Input<'a>(&'a [u8]);

impl<'a> Input<'a> {
    fn byte(&mut self) -> u8 {
        self.bytes(1).first().copied().unwrap_or_default()
    }

    fn bytes(&mut self, count: usize) -> &'a [u8] {
        let (found, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        found
    }

    /// Returns the true length, or now and then another one.
    fn length(&mut self, length: usize) -> u64 {
        match self.byte() {
            0xf0 => u64::MAX,
            0xf1 => u64::from(u32::MAX),
            0xf2 => u64::MAX - 8,
            0xf3 => 16 << 20,
            0xf4 => length as u64 + 1,
            0xf5 => (length as u64).saturating_sub(1),
            0xf6 => length as u64 ^ 1 << (self.byte() % 64),
            _ => length as u64,
        }
    }
}

fn text(text: &[u8]) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text].concat()
}

fn record(input: &mut Input, op: u8, body: &[u8]) -> Vec<u8> {
    let length = input.length(body.len());
    [&[op][..], &length.to_le_bytes(), body].concat()
}

fn chunk(input: &mut Input, content: &[u8]) -> Vec<u8> {
    let name: &[u8] = match input.byte() % 8 {
        0 => b"lz4",
        1 => b"zstd",
        2 => b"other",
        _ => b"",
    };
    let crc = match input.byte() {
        0xff => 1,
        value if value % 2 == 0 => 0,
        _ => crc32fast::hash(content),
    };
    let mut body = [0_u64.to_le_bytes(), 1_u64.to_le_bytes()].concat();
    body.extend(input.length(content.len()).to_le_bytes());
    body.extend(crc.to_le_bytes());
    body.extend(text(name));
    body.extend(input.length(content.len()).to_le_bytes());
    body.extend(content);
    record(input, 6, &body)
}

/// Builds records, within a chunk or outside.
fn records(input: &mut Input, depth: usize) -> Vec<u8> {
    let mut out = Vec::new();
    while !input.0.is_empty() && out.len() < 1 << 16 {
        let made = match input.byte() % 8 {
            0 => {
                let count = usize::from(input.byte());
                let content = input.bytes(count);
                chunk(input, content)
            }
            1 if depth < 3 => {
                let count = 4 * usize::from(input.byte());
                let content = records(&mut Input(input.bytes(count)), depth + 1);
                chunk(input, &content)
            }
            2 => {
                let topic = TOPICS[usize::from(input.byte()) % TOPICS.len()];
                let ids = [u16::from(input.byte() % 4).to_le_bytes(), [0; 2]].concat();
                let rest = [text(b"json"), 0_u32.to_le_bytes().to_vec()].concat();
                record(input, 4, &[ids, text(topic.as_bytes()), rest].concat())
            }
            3 => {
                let channel = u16::from(input.byte() % 4).to_le_bytes();
                let count = usize::from(input.byte());
                let json = input.bytes(count);
                record(input, 5, &[&channel[..], &[0; 20], json].concat())
            }
            4 => {
                let name = [text(b"name"), text(b"type")].concat();
                let count = usize::from(input.byte());
                let data = input.bytes(count);
                let length = input.length(data.len()).to_le_bytes();
                let body = [&[0; 16][..], &name, &length, data, &[0; 4]].concat();
                record(input, 9, &body)
            }
            5 => record(input, 15, &[0; 4]),
            6 => MAGIC.to_vec(),
            _ => {
                let (op, count) = (input.byte(), usize::from(input.byte()));
                let body = input.bytes(count);
                record(input, op, body)
            }
        };
        out.extend(made);
    }
    out
}

fuzz_target!(|data: &[u8]| {
    let bytes = [MAGIC, &records(&mut Input(data), 0)].concat();
    let path = Path::new("fuzz.mcap");
    let mut reader = CaptureReader::new(Cursor::new(&bytes), path).expect("it begins as MCAP");
    let mut entries = 0;
    while reader.next_entry().expect("memory can be read").is_some() {
        entries += 1;
    }
    let damage = reader.damage();
    assert!(damage.skipped_bytes + damage.truncated_bytes <= bytes.len() as u64);
    if let Ok(capture) = parse(&bytes, path) {
        assert_eq!((capture.entries.len(), capture.damage), (entries, damage));
    }
});
