//! One small mesh in every format, written here from the descriptions of the formats and not by the code under test.
#![allow(dead_code)] // Each test uses its part.

use std::fmt::Write as _;
use std::io::Write as _;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::Vector3;
use palpate_fem::mesh::TetMesh;

/// A box of 1/2 x 1/4 x 1/8 m in six tetrahedra around its diagonal, in two regions, with a set of the nodes at x = 0.
///
/// All coordinates are exact in single precision and in decimal notation.
pub(crate) fn cube() -> TetMesh {
    let corner = |i: u32| Vector3::new(f64::from(i & 1) / 2.0, f64::from(i >> 1 & 1) / 4.0, f64::from(i >> 2) / 8.0);
    // Each path along the axes from corner 0 to corner 7 spans a tetrahedron; odd orders of the axes are turned round.
    let paths = [[1, 2, 4], [2, 4, 1], [4, 1, 2], [2, 1, 4], [1, 4, 2], [4, 2, 1]];
    let tetrahedra =
        (0..).zip(paths).map(|(path, [a, b, _])| if path < 3 { [0, a, a + b, 7] } else { [0, a + b, a, 7] });
    TetMesh {
        nodes: (0..8).map(corner).collect(),
        tetrahedra: tetrahedra.collect(),
        regions: vec![0, 1, 0, 1, 1, 0],
        region_names: vec!["soft tissue".to_string(), "lesion".to_string()],
        node_sets: [("left".to_string(), vec![0, 2, 4, 6])].into(),
        ..TetMesh::default()
    }
}

/// A file: name, content, and a second file for TetGen.
pub(crate) struct Sample {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) ele: Option<Vec<u8>>,
    /// What the format keeps: names of regions and node sets, numbers of regions only, or neither.
    pub(crate) keeps: Keeps,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Keeps {
    Names,
    Numbers,
}

pub(crate) fn all() -> Vec<Sample> {
    let mesh = cube();
    let sample = |name, bytes, keeps| Sample { name, bytes, ele: None, keeps };
    let mut samples = vec![
        sample("v1.msh", msh1(&mesh), Keeps::Numbers),
        sample("v22.msh", msh22(&mesh, None), Keeps::Names),
        sample("v22_little.msh", msh22(&mesh, Some(Order::Little)), Keeps::Names),
        sample("v22_big.msh", msh22(&mesh, Some(Order::Big)), Keeps::Names),
        sample("v41.msh", msh41(&mesh, None), Keeps::Names),
        sample("v41_little.msh", msh41(&mesh, Some(Order::Little)), Keeps::Names),
        sample("v41_big.msh", msh41(&mesh, Some(Order::Big)), Keeps::Names),
        sample("v42.vtk", vtk(&mesh, false, false), Keeps::Numbers),
        sample("v42_binary.vtk", vtk(&mesh, true, false), Keeps::Numbers),
        sample("v51.vtk", vtk(&mesh, false, true), Keeps::Numbers),
        sample("v51_binary.vtk", vtk(&mesh, true, true), Keeps::Numbers),
        sample("medit.mesh", medit(&mesh), Keeps::Numbers),
    ];
    for (name, style) in VTU_STYLES {
        samples.push(sample(name, vtu(&mesh, style), Keeps::Numbers));
    }
    let (node, ele) = tetgen(&mesh);
    samples.push(Sample { name: "tetgen.node", bytes: node, ele: Some(ele), keeps: Keeps::Numbers });
    samples
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Order {
    Little,
    Big,
}

fn int(bytes: &mut Vec<u8>, order: Order, value: i32) {
    bytes.extend(if order == Order::Little { value.to_le_bytes() } else { value.to_be_bytes() });
}

fn long(bytes: &mut Vec<u8>, order: Order, value: u64) {
    bytes.extend(if order == Order::Little { value.to_le_bytes() } else { value.to_be_bytes() });
}

fn double(bytes: &mut Vec<u8>, order: Order, value: f64) {
    long(bytes, order, value.to_bits());
}

pub(crate) fn msh1(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("$NOD\n{}\n", mesh.nodes.len());
    for (i, x) in (1..).zip(&mesh.nodes) {
        // Numbers with gaps, as Gmsh writes them.
        writeln!(text, "{} {} {} {}", 10 * i, x.x, x.y, x.z).unwrap();
    }
    writeln!(text, "$ENDNOD\n$ELM\n{}\n1 15 4 1 1 10", mesh.tetrahedra.len() + 1).unwrap();
    for (i, (t, region)) in (2..).zip(mesh.tetrahedra.iter().zip(&mesh.regions)) {
        let [a, b, c, d] = t.map(|node| 10 * (node + 1));
        writeln!(text, "{i} 4 {} 1 4 {a} {b} {c} {d}", region + 1).unwrap();
    }
    text.push_str("$ENDELM\n");
    text.into_bytes()
}

const NAMES: &str = "$PhysicalNames\n3\n2 5 \"left\"\n3 1 \"soft tissue\"\n3 2 \"lesion\"\n$EndPhysicalNames\n";

/// The two triangles that the box has at x = 0.
const LEFT: [[u32; 3]; 2] = [[0, 4, 6], [0, 6, 2]];

pub(crate) fn msh22(mesh: &TetMesh, order: Option<Order>) -> Vec<u8> {
    let mut bytes = format!("$MeshFormat\n2.2 {} 8\n", u8::from(order.is_some())).into_bytes();
    if let Some(order) = order {
        int(&mut bytes, order, 1);
        bytes.push(b'\n');
    }
    write!(bytes, "$EndMeshFormat\n{NAMES}$Nodes\n{}\n", mesh.nodes.len()).unwrap();
    for (i, x) in (1..).zip(&mesh.nodes) {
        match order {
            None => writeln!(bytes, "{i} {} {} {}", x.x, x.y, x.z).unwrap(),
            Some(order) => {
                int(&mut bytes, order, i);
                x.iter().for_each(|&value| double(&mut bytes, order, value));
            }
        }
    }
    write!(bytes, "\n$EndNodes\n$Elements\n{}\n", mesh.tetrahedra.len() + 2).unwrap();
    let mut elements: Vec<(i32, i32, Vec<u32>)> = LEFT.iter().map(|nodes| (2, 5, nodes.to_vec())).collect();
    elements.extend(mesh.tetrahedra.iter().zip(&mesh.regions).map(|(t, &r)| (4, i32::from(r) + 1, t.to_vec())));
    for run in elements.chunk_by(|a, b| a.0 == b.0) {
        if let Some(order) = order {
            [run[0].0, run.len() as i32, 2].iter().for_each(|&value| int(&mut bytes, order, value));
        }
        for (kind, group, nodes) in run {
            let nodes = nodes.iter().map(|&node| node as i32 + 1);
            match order {
                None => {
                    let nodes: Vec<String> = nodes.map(|node| node.to_string()).collect();
                    writeln!(bytes, "7 {kind} 2 {group} 1 {}", nodes.join(" ")).unwrap();
                }
                Some(order) => [7, *group, 1].into_iter().chain(nodes).for_each(|value| int(&mut bytes, order, value)),
            }
        }
    }
    bytes.extend(b"\n$EndElements\n");
    bytes
}

/// A number of 32 or 64 bits, or real: what MSH 4.1 is made of.
enum Item {
    I(i32),
    L(u64),
    D(f64),
}

fn items(bytes: &mut Vec<u8>, order: Option<Order>, items: impl IntoIterator<Item = Item>) {
    for item in items {
        match (order, item) {
            (None, Item::I(value)) => write!(bytes, "{value} ").unwrap(),
            (None, Item::L(value)) => write!(bytes, "{value} ").unwrap(),
            (None, Item::D(value)) => write!(bytes, "{value} ").unwrap(),
            (Some(order), Item::I(value)) => int(bytes, order, value),
            (Some(order), Item::L(value)) => long(bytes, order, value),
            (Some(order), Item::D(value)) => double(bytes, order, value),
        }
    }
    if order.is_none() {
        bytes.push(b'\n');
    }
}

pub(crate) fn msh41(mesh: &TetMesh, order: Option<Order>) -> Vec<u8> {
    use Item::{D, I, L};
    let mut bytes = format!("$MeshFormat\n4.1 {} 8\n", u8::from(order.is_some())).into_bytes();
    if let Some(order) = order {
        int(&mut bytes, order, 1);
        bytes.push(b'\n');
    }
    // A point, a surface in the group "left", and two volumes; the second is in its group with negative orientation.
    write!(bytes, "$EndMeshFormat\n{NAMES}$Entities\n").unwrap();
    items(&mut bytes, order, [L(1), L(0), L(1), L(2)]);
    items(&mut bytes, order, [I(1), D(0.0), D(0.0), D(0.0), L(0)]);
    let bounds = || (0..6).map(|_| D(0.0));
    items(&mut bytes, order, [I(3)].into_iter().chain(bounds()).chain([L(1), I(5), L(0)]));
    items(&mut bytes, order, [I(11)].into_iter().chain(bounds()).chain([L(1), I(1), L(1), I(3)]));
    items(&mut bytes, order, [I(12)].into_iter().chain(bounds()).chain([L(1), I(-2), L(0)]));
    let count = mesh.nodes.len() as u64;
    write!(bytes, "\n$EndEntities\n$Nodes\n").unwrap();
    items(&mut bytes, order, [L(2), L(count), L(1), L(count)]);
    // The first node belongs to the point; the others to the surface, with parameters.
    items(&mut bytes, order, [I(0), I(1), I(0), L(1), L(1)]);
    items(&mut bytes, order, mesh.nodes[0].iter().map(|&value| D(value)));
    items(&mut bytes, order, [I(2), I(3), I(1), L(count - 1)]);
    items(&mut bytes, order, (2..=count).map(L));
    for x in &mesh.nodes[1..] {
        items(&mut bytes, order, [x.x, x.y, x.z, 0.5, 0.25].map(D));
    }
    let total = mesh.tetrahedra.len() as u64 + 2;
    write!(bytes, "\n$EndNodes\n$Elements\n").unwrap();
    let blocks = mesh.regions.chunk_by(|a, b| a == b).count() as u64 + 1;
    items(&mut bytes, order, [L(blocks), L(total), L(1), L(total)]);
    items(&mut bytes, order, [I(2), I(3), I(2), L(2)]);
    for nodes in LEFT {
        items(&mut bytes, order, [1].into_iter().chain(nodes.map(|node| u64::from(node) + 1)).map(L));
    }
    let mut tetrahedra = mesh.tetrahedra.iter();
    for run in mesh.regions.chunk_by(|a, b| a == b) {
        items(&mut bytes, order, [I(3), I(11 + i32::from(run[0])), I(4), L(run.len() as u64)]);
        for t in tetrahedra.by_ref().take(run.len()) {
            items(&mut bytes, order, [9].into_iter().chain(t.map(|node| u64::from(node) + 1)).map(L));
        }
    }
    bytes.extend(b"\n$EndElements\n$NodeData\n1\n\"ignored\"\n$EndNodeData\n");
    bytes
}

/// Numbers as text or as big-endian bytes, on a line of their own.
fn vtk_numbers(bytes: &mut Vec<u8>, binary: bool, kind: &str, values: impl IntoIterator<Item = f64>) {
    for value in values {
        match (binary, kind) {
            (false, _) => write!(bytes, "{value} ").unwrap(),
            (true, "double") => bytes.extend(value.to_be_bytes()),
            (true, "float") => bytes.extend((value as f32).to_be_bytes()),
            (true, "int") => bytes.extend((value as i32).to_be_bytes()),
            (true, "unsigned_char") => bytes.push(value as u8),
            (true, _) => bytes.extend((value as i64).to_be_bytes()),
        }
    }
    bytes.push(b'\n');
}

pub(crate) fn vtk(mesh: &TetMesh, binary: bool, version_5: bool) -> Vec<u8> {
    let (nodes, cells) = (mesh.nodes.len(), mesh.tetrahedra.len() + 1);
    let version = if version_5 { "5.1" } else { "4.2" };
    let format = if binary { "BINARY" } else { "ASCII" };
    let mut bytes =
        format!("# vtk DataFile Version {version}\nbox\n{format}\nDATASET UNSTRUCTURED_GRID\n").into_bytes();
    writeln!(bytes, "POINTS {nodes} float").unwrap();
    vtk_numbers(&mut bytes, binary, "float", mesh.nodes.iter().flatten().copied());
    // A triangle first, then the tetrahedra.
    let lists: Vec<Vec<u32>> =
        std::iter::once(LEFT[0].to_vec()).chain(mesh.tetrahedra.iter().map(|t| t.to_vec())).collect();
    let length: usize = lists.iter().map(Vec::len).sum();
    if version_5 {
        let ends = lists.iter().scan(0.0, |end, list| {
            *end += list.len() as f64;
            Some(*end)
        });
        writeln!(bytes, "CELLS {} {length}\nOFFSETS vtktypeint64", cells + 1).unwrap();
        vtk_numbers(&mut bytes, binary, "vtktypeint64", std::iter::once(0.0).chain(ends));
        writeln!(bytes, "CONNECTIVITY vtktypeint64").unwrap();
        vtk_numbers(&mut bytes, binary, "vtktypeint64", lists.iter().flatten().map(|&node| f64::from(node)));
    } else {
        writeln!(bytes, "CELLS {cells} {}", length + cells).unwrap();
        for list in &lists {
            let line = std::iter::once(list.len() as f64).chain(list.iter().map(|&node| f64::from(node)));
            vtk_numbers(&mut bytes, binary, "int", line);
            // Binary lists have no line ends between cells.
            if binary {
                bytes.pop();
            }
        }
    }
    writeln!(bytes, "CELL_TYPES {cells}").unwrap();
    vtk_numbers(&mut bytes, binary, "int", std::iter::once(5.0).chain(mesh.tetrahedra.iter().map(|_| 10.0)));
    writeln!(bytes, "POINT_DATA {nodes}\nSCALARS height double 1\nLOOKUP_TABLE default").unwrap();
    vtk_numbers(&mut bytes, binary, "double", mesh.nodes.iter().map(|x| x.z));
    writeln!(bytes, "VECTORS u float").unwrap();
    vtk_numbers(&mut bytes, binary, "float", mesh.nodes.iter().flatten().copied());
    writeln!(bytes, "CELL_DATA {cells}\nFIELD FieldData 2\nquality%20x 1 {cells} double").unwrap();
    vtk_numbers(&mut bytes, binary, "double", (0..cells).map(|c| c as f64));
    writeln!(bytes, "METADATA\nINFORMATION 0\n\nregion 1 {cells} int").unwrap();
    let regions = std::iter::once(0.0).chain(mesh.regions.iter().map(|&region| f64::from(region) + 1.0));
    vtk_numbers(&mut bytes, binary, "int", regions);
    bytes
}

/// How a VTU file stores its numbers.
#[derive(Clone, Copy)]
pub(crate) struct VtuStyle {
    pub(crate) appended: bool,
    pub(crate) raw: bool,
    pub(crate) zlib: bool,
    pub(crate) wide: bool,
    pub(crate) text: bool,
    pub(crate) order: Order,
}

const fn style(appended: bool, raw: bool, zlib: bool, wide: bool, order: Order) -> VtuStyle {
    VtuStyle { appended, raw, zlib, wide, text: false, order }
}

const VTU_STYLES: [(&str, VtuStyle); 7] = [
    ("text.vtu", VtuStyle { text: true, ..style(false, false, false, false, Order::Little) }),
    ("base64.vtu", style(false, false, false, false, Order::Little)),
    ("base64_zlib.vtu", style(false, false, true, true, Order::Big)),
    ("appended_raw.vtu", style(true, true, false, true, Order::Big)),
    ("appended_raw_zlib.vtu", style(true, true, true, false, Order::Little)),
    ("appended_base64.vtu", style(true, false, false, false, Order::Big)),
    ("appended_base64_zlib.vtu", style(true, false, true, true, Order::Little)),
];

/// One array as its type, name, components and numbers.
type VtuArray<'a> = (&'a str, &'a str, usize, Vec<f64>);

fn vtu_head(bytes: &mut Vec<u8>, style: VtuStyle, value: usize) {
    if style.wide {
        long(bytes, style.order, value as u64);
    } else {
        int(bytes, style.order, value as i32);
    }
}

/// The head and the content of a binary array: in base64, both together, or each on its own if compressed.
fn vtu_binary(style: VtuStyle, kind: &str, values: &[f64]) -> Vec<u8> {
    let mut data = Vec::new();
    for &value in values {
        match kind {
            "Float64" => double(&mut data, style.order, value),
            "Int64" => long(&mut data, style.order, value as u64),
            "Int32" => int(&mut data, style.order, value as i32),
            _ => data.push(value as u8),
        }
    }
    let mut head = Vec::new();
    if !style.zlib {
        vtu_head(&mut head, style, data.len());
        head.extend(data);
        return if style.raw { head } else { STANDARD.encode(head).into_bytes() };
    }
    // Blocks of 64 bytes, so that there are several.
    let blocks: Vec<Vec<u8>> = data
        .chunks(64)
        .map(|block| {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(block).unwrap();
            encoder.finish().unwrap()
        })
        .collect();
    [blocks.len(), 64, data.len() % 64].iter().for_each(|&value| vtu_head(&mut head, style, value));
    blocks.iter().for_each(|block| vtu_head(&mut head, style, block.len()));
    let body = blocks.concat();
    if style.raw { [head, body].concat() } else { (STANDARD.encode(head) + &STANDARD.encode(body)).into_bytes() }
}

pub(crate) fn vtu(mesh: &TetMesh, style: VtuStyle) -> Vec<u8> {
    let ends = (1..=mesh.tetrahedra.len()).map(|cell| 4.0 * cell as f64).collect();
    let connectivity = mesh.tetrahedra.iter().flatten().map(|&node| f64::from(node)).collect();
    let regions = mesh.regions.iter().map(|&region| f64::from(region) + 1.0).collect();
    let sections: [(&str, Vec<VtuArray>); 3] = [
        ("CellData", vec![("Int32", "MaterialId", 1, regions)]),
        ("Points", vec![("Float64", "Points", 3, mesh.nodes.iter().flatten().copied().collect())]),
        (
            "Cells",
            vec![
                ("Int64", "connectivity", 1, connectivity),
                ("Int64", "offsets", 1, ends),
                ("UInt8", "types", 1, vec![10.0; mesh.tetrahedra.len()]),
            ],
        ),
    ];
    let order = if style.order == Order::Little { "LittleEndian" } else { "BigEndian" };
    let header = if style.wide { "UInt64" } else { "UInt32" };
    let compressor = if style.zlib { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"{order}\" \
         header_type=\"{header}\"{compressor}>\n<!-- a box -->\n<UnstructuredGrid>\n\
         <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n",
        mesh.nodes.len(),
        mesh.tetrahedra.len()
    );
    let mut appended = Vec::new();
    for (section, arrays) in sections {
        writeln!(text, "<{section}>").unwrap();
        for (kind, name, components, values) in arrays {
            write!(text, "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" ").unwrap();
            if style.text {
                let words: Vec<String> = values.iter().map(f64::to_string).collect();
                writeln!(text, "format=\"ascii\">\n{}\n</DataArray>", words.join(" ")).unwrap();
                continue;
            }
            let stored = vtu_binary(style, kind, &values);
            if style.appended {
                writeln!(text, "format=\"appended\" offset=\"{}\"/>", appended.len()).unwrap();
                appended.extend(stored);
            } else {
                // VTK puts a description of the components behind the numbers.
                let stored = String::from_utf8(stored).unwrap();
                writeln!(text, "format=\"binary\">\n{stored}\n<InformationKey name=\"x\"/>\n</DataArray>").unwrap();
            }
        }
        writeln!(text, "</{section}>").unwrap();
    }
    text.push_str("</Piece>\n</UnstructuredGrid>\n");
    let mut bytes = text.into_bytes();
    if style.appended {
        write!(bytes, "<AppendedData encoding=\"{}\">\n_", if style.raw { "raw" } else { "base64" }).unwrap();
        bytes.extend(appended);
        bytes.extend(b"\n</AppendedData>\n");
    }
    bytes.extend(b"</VTKFile>\n");
    bytes
}

pub(crate) fn medit(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("MeshVersionFormatted 2\nDimension 3\n# nodes\nVertices\n{}\n", mesh.nodes.len());
    for x in &mesh.nodes {
        writeln!(text, "{} {} {} 0", x.x, x.y, x.z).unwrap();
    }
    let [a, b, c] = LEFT[0].map(|node| node + 1);
    writeln!(text, "Triangles 1\n{a} {b} {c} 5\nCorners 2\n1\n8\nTetrahedra\n{}", mesh.tetrahedra.len()).unwrap();
    for (t, region) in mesh.tetrahedra.iter().zip(&mesh.regions) {
        let [a, b, c, d] = t.map(|node| node + 1);
        writeln!(text, "{a} {b} {c} {d} {}", region + 1).unwrap();
    }
    text.push_str("End\n");
    text.into_bytes()
}

pub(crate) fn tetgen(mesh: &TetMesh) -> (Vec<u8>, Vec<u8>) {
    let mut node = format!("# a box\n{} 3 1 1\n", mesh.nodes.len());
    for (i, x) in mesh.nodes.iter().enumerate() {
        let marker = if x.x == 0.0 { 5 } else { 0 };
        writeln!(node, "{i} {} {} {} 0.5 {marker}", x.x, x.y, x.z).unwrap();
    }
    let mut ele = format!("{} 4 1\n", mesh.tetrahedra.len());
    for (i, (t, region)) in mesh.tetrahedra.iter().zip(&mesh.regions).enumerate() {
        let [a, b, c, d] = *t;
        writeln!(ele, "{i} {a} {b} {c} {d} {}", region + 1).unwrap();
    }
    (node.into_bytes(), ele.into_bytes())
}
