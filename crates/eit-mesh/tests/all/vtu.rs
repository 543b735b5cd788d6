//! VTU files, read back by an independent XML parser and base64 decoder.

use crate::surfaces;
use base64::Engine as _;
use eit_mesh::{Electrode, ElementField, Mesh, MeshError, write_vtu};
use proptest::prelude::*;
use roxmltree::{Document, Node};

/// Returns the bytes of a named array after checking its type and leading length.
fn array(document: &Document<'_>, parent: &str, name: &str, kind: &str) -> Vec<u8> {
    let is_array = |n: &Node<'_, '_>| {
        n.has_tag_name("DataArray")
            && n.attribute("Name") == Some(name)
            && n.parent().is_some_and(|p| p.has_tag_name(parent))
    };
    let node = document.descendants().find(is_array).unwrap();
    assert_eq!((node.attribute("type"), node.attribute("format")), (Some(kind), Some("binary")));
    let text = node.text().unwrap().trim();
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
    let (length, values) = bytes.split_at(8);
    assert_eq!(u64::from_le_bytes(length.try_into().unwrap()), values.len() as u64);
    values.to_vec()
}

fn numbers<T, const N: usize>(bytes: &[u8], from: fn([u8; N]) -> T) -> Vec<T> {
    assert_eq!(bytes.len() % N, 0);
    bytes.chunks_exact(N).map(|chunk| from(chunk.try_into().unwrap())).collect()
}

/// Checks a file against its mesh and fields, bit for bit.
fn check(mesh: &Mesh, fields: &[ElementField<'_>]) {
    let mut bytes = Vec::new();
    write_vtu(mesh, &mut bytes, fields).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    let xml = Document::parse(&text).unwrap();
    let root = xml.root_element();
    assert!(root.has_tag_name("VTKFile"));
    assert_eq!(root.attribute("type"), Some("UnstructuredGrid"));
    assert_eq!(root.attribute("byte_order"), Some("LittleEndian"));
    assert_eq!(root.attribute("header_type"), Some("UInt64"));

    let bits = |parent, name| numbers(&array(&xml, parent, name, "Float64"), u64::from_le_bytes);
    let integers = |parent, name| numbers(&array(&xml, parent, name, "Int64"), i64::from_le_bytes);
    let wanted: Vec<u64> = mesh.surface().nodes().iter().flatten().map(|x| x.to_bits()).collect();
    assert_eq!(bits("Points", "Points"), wanted);

    let (nodes, ends) = (integers("Cells", "connectivity"), integers("Cells", "offsets"));
    let kinds = array(&xml, "Cells", "types", "UInt8");
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let cells: Vec<&[i64]> =
        starts.zip(&ends).map(|(start, &end)| &nodes[start as usize..end as usize]).collect();
    assert_eq!(ends.last().copied(), Some(nodes.len() as i64));
    let triangles = mesh.surface().triangles();
    let mut wanted: Vec<(u8, Vec<u32>, i64)> =
        triangles.iter().map(|t| (5, t.to_vec(), 0)).collect();
    for (number, electrode) in (1..).zip(mesh.electrodes()) {
        match electrode {
            Electrode::Rim(edges) => wanted.extend(edges.iter().map(|e| (3, e.to_vec(), number))),
            Electrode::Patch(patch) => patch.iter().for_each(|&t| wanted[t as usize].2 = number),
        }
    }
    let cells = cells.iter().zip(kinds).zip(integers("CellData", "electrode"));
    let found: Vec<(u8, Vec<u32>, i64)> = cells
        .map(|((cell, kind), number)| (kind, cell.iter().map(|&n| n as u32).collect(), number))
        .collect();
    assert_eq!(found, wanted);
    let piece = xml.descendants().find(|n| n.has_tag_name("Piece")).unwrap();
    assert_eq!(piece.attribute("NumberOfCells"), Some(wanted.len().to_string().as_str()));
    let points = mesh.surface().nodes().len().to_string();
    assert_eq!(piece.attribute("NumberOfPoints"), Some(points.as_str()));

    for field in fields {
        let found = bits("CellData", field.name);
        assert_eq!(found.len(), wanted.len());
        let (values, edges) = found.split_at(triangles.len());
        assert!(values.iter().copied().eq(field.values.iter().map(|x| x.to_bits())));
        // a line has the value of the triangle that contains both its ends
        for ((_, ends, _), value) in wanted[triangles.len()..].iter().zip(edges) {
            let owner = triangles.iter().position(|t| ends.iter().all(|n| t.contains(n))).unwrap();
            assert_eq!(*value, field.values[owner].to_bits());
        }
    }
}

#[test]
fn refuses_fields_that_do_not_fit() {
    let mesh = surfaces::with_electrodes(surfaces::disc(2, 0.1));
    let mut out = Vec::new();
    let mut write = |name, values| write_vtu(&mesh, &mut out, &[ElementField { name, values }]);
    for name in ["electrode", "two\nlines"] {
        assert_eq!(write(name, &[0.0; 24]), Err(MeshError::BadFieldName { name: name.into() }));
    }
    assert_eq!(
        write("x", &[0.0; 25]),
        Err(MeshError::WrongLength { what: "values per triangle", found: 25, wanted: 24 })
    );
    assert!(out.is_empty());
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// Every remainder of the base64 groups, every kind of number, and names that XML must escape.
    #[test]
    fn any_mesh_and_values(
        rings in 2_u32..6,
        exponent in -60_i32..60,
        stretch in prop::array::uniform3(0.5_f64..2.0),
        bits in prop::collection::vec(any::<u64>(), 150),
    ) {
        let scale = 10.0_f64.powi(exponent);
        let surface = surfaces::moved(&surfaces::disc(rings, 1.0), |[x, y, _]| {
            [scale * stretch[0] * x, scale * stretch[1] * y, scale * stretch[2] * x * y]
        });
        let mut values: Vec<f64> = bits.into_iter().map(f64::from_bits).collect();
        values[3..6].copy_from_slice(&[f64::NAN, -0.0, f64::from_bits(1)]);
        let values = &values[..surface.triangles().len()];
        let zeros = vec![0.0; values.len()];
        let fields = [("a<b & \"c\">d", values), ("zero", &zeros)];
        let fields = fields.map(|(name, values)| ElementField { name, values });
        check(&surfaces::with_electrodes(surface.clone()), &fields);
        check(&Mesh::new(surface, vec![]).unwrap(), &[]);
    }
}
