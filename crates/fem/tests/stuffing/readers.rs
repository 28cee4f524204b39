//! Readers of label images and closed surfaces: what they read, and that no bytes make them panic.

use std::io::Write;

use nalgebra::Vector3;
use palpate_fem::closed_surface::ClosedSurface;
use palpate_fem::image::LabelImage;
use proptest::prelude::*;

fn inrimage() -> Vec<u8> {
    let mut bytes = b"#INRIMAGE-4#{\nXDIM=3\nYDIM=2\nZDIM=4\nVDIM=1\nTYPE=unsigned fixed\nPIXSIZE=8 bits\nSCALE=2**0\nCPU=decm\nVX=0.5\nVY=1\nVZ=2.5\n".to_vec();
    bytes.resize(252, b'\n');
    bytes.extend(b"##}\n");
    bytes.extend(0..24u8);
    bytes
}

/// A NIfTI-1 of 3 x 2 x 4 voxels with the labels 0 to 23.
fn nifti(datatype: i16, big_endian: bool, determinant: f32) -> Vec<u8> {
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, value: &[u8]| {
        let mut value = value.to_vec();
        if big_endian {
            value.reverse();
        }
        bytes[at..at + value.len()].copy_from_slice(&value);
    };
    put(0, &348i32.to_le_bytes());
    for (i, d) in [3i16, 3, 2, 4, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * i, &d.to_le_bytes());
    }
    let (size, bits) = match datatype {
        2 => (1, 8i16),
        4 => (2, 16),
        _ => (4, 32),
    };
    put(70, &datatype.to_le_bytes());
    put(72, &bits.to_le_bytes());
    for (i, p) in [1.0f32, 0.5, 1.0, 2.5].into_iter().enumerate() {
        put(76 + 4 * i, &p.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    put(280, &(0.5 * determinant).to_le_bytes());
    put(300, &1f32.to_le_bytes());
    put(320, &2.5f32.to_le_bytes());
    bytes[344..348].copy_from_slice(b"n+1\0");
    for label in 0..24u8 {
        let mut value = match datatype {
            16 => f32::from(label).to_le_bytes().to_vec(),
            _ => i32::from(label).to_le_bytes()[..size].to_vec(),
        };
        if big_endian {
            value.reverse();
        }
        bytes.extend(value);
    }
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn expected() -> LabelImage {
    LabelImage::new([3, 2, 4], [0.5e-3, 1e-3, 2.5e-3], Vector3::zeros(), (0..24).collect()).unwrap()
}

const TETRAHEDRON_STL: &str = "solid t
facet normal 0 0 -1\n outer loop\n vertex 0 0 0\n vertex 0 1 0\n vertex 1 0 0\n endloop\nendfacet
facet normal 0 -1 0\n outer loop\n vertex 0 0 0\n vertex 1 0 0\n vertex 0 0 1\n endloop\nendfacet
facet normal -1 0 0\n outer loop\n vertex 0 -0 0\n vertex 0 0 1\n vertex 0 1 0\n endloop\nendfacet
facet normal 1 1 1\n outer loop\n vertex 1 0 0\n vertex 0 1 0\n vertex 0 0 1\n endloop\nendfacet
endsolid t\n";

const TETRAHEDRON_OBJ: &str = "# a tetrahedron\nmtllib none.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n\
    f 1 3 2\nv 0 0 1\nf 1/1 2/1/1 4//1\ng side\nf -4 -1 -2\nf 2 3 \\\n4\n";

const TETRAHEDRON_PLY: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\n\
    end_header\n0 0 0 255\n1 0 0 255\n0 1 0 255\n0 0 1 255\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

/// The same tetrahedron as binary STL, with a header that begins with "solid" as many programs write it.
fn binary_stl() -> Vec<u8> {
    let v = [[0f32, 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(4u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3usize]] {
        bytes.extend([0u8; 12]);
        face.iter().flat_map(|&i| v[i]).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0u8; 2]);
    }
    bytes
}

/// The same as binary PLY of either byte order.
fn binary_ply(big_endian: bool) -> Vec<u8> {
    let order = if big_endian { "big" } else { "little" };
    let header = TETRAHEDRON_PLY.split("end_header\n").next().unwrap();
    let mut bytes = header.replace("ascii", &format!("binary_{order}_endian")).into_bytes();
    bytes.extend(b"end_header\n");
    for v in [[0f32, 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]] {
        v.iter().for_each(|x| bytes.extend(if big_endian { x.to_be_bytes() } else { x.to_le_bytes() }));
        bytes.push(255);
    }
    for face in [[0i32, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        bytes.push(3);
        face.iter().for_each(|i| bytes.extend(if big_endian { i.to_be_bytes() } else { i.to_le_bytes() }));
    }
    bytes
}

#[test]
fn inrimages_are_read_plain_and_compressed() {
    assert_eq!(LabelImage::from_inrimage_bytes(&inrimage()).unwrap(), expected());
    assert_eq!(LabelImage::from_inrimage_bytes(&gzip(&inrimage())).unwrap(), expected());
    let image = expected();
    assert_eq!(image.label_at(&Vector3::new(1.1e-3, 1.9e-3, 9.9e-3)), 23);
    assert_eq!(image.label_at(&Vector3::new(1.6e-3, 1.9e-3, 9.9e-3)), 0, "outside");
}

#[test]
fn nifti_is_read_in_every_number_type_and_byte_order() {
    for datatype in [2, 4, 8, 16] {
        for big_endian in [false, true] {
            let bytes = nifti(datatype, big_endian, 1.0);
            assert_eq!(LabelImage::from_nifti_bytes(&bytes).unwrap(), expected(), "datatype {datatype}");
            assert_eq!(LabelImage::from_nifti_bytes(&gzip(&bytes)).unwrap(), expected());
        }
    }
}

#[test]
fn a_left_handed_nifti_is_reversed_along_x() {
    let image = LabelImage::from_nifti_bytes(&nifti(2, false, -1.0)).unwrap();
    assert_eq!(&image.labels[..6], [2, 1, 0, 5, 4, 3]);
}

#[test]
fn all_surface_formats_give_the_same_tetrahedron() {
    let surfaces = [
        ClosedSurface::from_stl_bytes(TETRAHEDRON_STL.as_bytes(), 1.0),
        ClosedSurface::from_stl_bytes(&binary_stl(), 1.0),
        ClosedSurface::from_obj_bytes(TETRAHEDRON_OBJ.as_bytes(), 1.0),
        ClosedSurface::from_ply_bytes(TETRAHEDRON_PLY.as_bytes(), 1.0),
        ClosedSurface::from_ply_bytes(&binary_ply(false), 1.0),
        ClosedSurface::from_ply_bytes(&binary_ply(true), 1.0),
    ];
    for surface in surfaces {
        let surface = surface.unwrap();
        assert_eq!((surface.vertices().len(), surface.triangles().len()), (4, 4));
        assert!((surface.volume() - 1.0 / 6.0).abs() < 1e-15);
    }
    let scaled = ClosedSurface::from_stl_bytes(&binary_stl(), 1e-3).unwrap();
    assert!((scaled.volume() - 1e-9 / 6.0).abs() < 1e-24);
}

#[test]
fn files_are_read_by_their_names_and_missing_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    assert!(LabelImage::from_path(write("a.inr", &inrimage())).is_ok());
    assert!(LabelImage::from_path(write("a.NII.gz", &gzip(&nifti(2, false, 1.0)))).is_ok());
    assert!(ClosedSurface::from_path(write("a.STL", &binary_stl()), 1.0).is_ok());
    assert!(ClosedSurface::from_path(write("a.obj", TETRAHEDRON_OBJ.as_bytes()), 1.0).is_ok());
    assert!(ClosedSurface::from_path(write("a.ply", TETRAHEDRON_PLY.as_bytes()), 1.0).is_ok());
    let message = |error: &dyn std::error::Error| error.to_string();
    let cases = [
        (message(&LabelImage::from_path(folder.path().join("none.inr")).unwrap_err()), "none.inr"),
        (message(&LabelImage::from_path(write("a.png", b"")).unwrap_err()), ".inr.gz"),
        (message(&ClosedSurface::from_path(folder.path().join("none.stl"), 1.0).unwrap_err()), "none.stl"),
        (message(&ClosedSurface::from_path(write("a.fbx", b""), 1.0).unwrap_err()), "STL, OBJ or PLY"),
        (
            message(&ClosedSurface::from_path(write("b.obj", b"v 0 0 0\nv 1 x 0\n"), 1.0).unwrap_err()),
            "b.obj: OBJ: line 2",
        ),
        (message(&LabelImage::from_path(write("b.inr", &inrimage()[..270])).unwrap_err()), "b.inr: INRIMAGE-4: "),
    ];
    for (message, part) in cases {
        assert!(message.contains(part), "{message}");
    }
}

/// The claim of a header is no reason to allocate: these ask for a gibibyte from some hundred bytes.
#[test]
fn headers_that_claim_more_than_the_file_holds_are_refused() {
    let mut text = String::from_utf8(inrimage()).unwrap();
    text = text.replacen("XDIM=3", "XDIM=1000", 1).replacen("YDIM=2", "YDIM=1000", 1).replacen(
        "ZDIM=4\n",
        "ZDIM=1000\n",
        1,
    );
    let header: String = text[..text.find("VZ").unwrap()].to_owned() + "VZ=2.5\n";
    let mut bytes = header.into_bytes();
    bytes.resize(252, b'\n');
    bytes.extend(b"##}\n0123456789");
    for bytes in [bytes.clone(), gzip(&bytes)] {
        let message = LabelImage::from_inrimage_bytes(&bytes).unwrap_err().to_string();
        assert!(message.contains("1000000000 bytes"), "{message}");
    }
    let mut bytes = nifti(2, false, 1.0);
    for axis in 0..3 {
        bytes[42 + 2 * axis..44 + 2 * axis].copy_from_slice(&1000i16.to_le_bytes());
    }
    assert!(LabelImage::from_nifti_bytes(&bytes).unwrap_err().to_string().contains("1000000000 bytes"));

    let mut stl = binary_stl();
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(ClosedSurface::from_stl_bytes(&stl, 1.0).is_err());
    for (from, to) in [("vertex 4", "vertex 4000000000"), ("face 4", "face 4000000000")] {
        let ply = TETRAHEDRON_PLY.replace(from, to);
        assert!(ClosedSurface::from_ply_bytes(ply.as_bytes(), 1.0).is_err());
    }
    let idle = "ply\nformat binary_little_endian 1.0\nelement idle 60\nend_header\n".to_owned() + &" ".repeat(64);
    assert!(ClosedSurface::from_ply_bytes(idle.as_bytes(), 1.0).is_err(), "elements without properties take no bytes");
}

#[test]
fn labels_that_are_none_are_refused_by_value() {
    let mut bytes = nifti(16, false, 1.0);
    bytes[352 + 4 * 7..352 + 4 * 8].copy_from_slice(&0.5f32.to_le_bytes());
    let message = LabelImage::from_nifti_bytes(&bytes).unwrap_err().to_string();
    assert!(message.contains("voxel 7") && message.contains("0.5"), "{message}");
    let text = String::from_utf8_lossy(&inrimage()).replacen("PIXSIZE=8 bits", "PIXSIZE=16 bit", 1);
    assert!(LabelImage::from_inrimage_bytes(text.as_bytes()).unwrap_err().to_string().contains("8 bits"));
}

/// Every reader on the same bytes; the results do not matter, only that there is one.
fn read_all(bytes: &[u8]) {
    let _ = LabelImage::from_inrimage_bytes(bytes);
    let _ = LabelImage::from_nifti_bytes(bytes);
    let _ = ClosedSurface::from_stl_bytes(bytes, 1.0);
    let _ = ClosedSurface::from_obj_bytes(bytes, 1.0);
    let _ = ClosedSurface::from_ply_bytes(bytes, 1.0);
}

fn samples() -> Vec<Vec<u8>> {
    vec![
        inrimage(),
        gzip(&inrimage()),
        nifti(2, false, 1.0),
        nifti(16, true, -1.0),
        TETRAHEDRON_STL.into(),
        binary_stl(),
        TETRAHEDRON_OBJ.into(),
        TETRAHEDRON_PLY.into(),
        binary_ply(false),
        binary_ply(true),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(
        sample in 0..10usize,
        cut in 0.0..1.3f64,
        edits in prop::collection::vec((0.0..1.0f64, any::<u8>()), 0..6),
        insert in prop::option::of((0.0..1.0f64, "-?[0-9]{1,20}")),
    ) {
        let mut bytes = samples().swap_remove(sample);
        for (at, value) in edits {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        if let Some((at, number)) = insert {
            let at = (at * bytes.len() as f64) as usize;
            bytes.splice(at..at, number.bytes());
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        read_all(&bytes);
    }

    #[test]
    fn noise_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        read_all(&bytes);
    }
}
