//! INRIMAGE-4: a header of text lines `KEY=VALUE` between `#INRIMAGE-4#{` and `##}`, padded with newlines to a
//! multiple of 256 bytes, then the voxels, x fastest.

use nalgebra::Vector3;

use super::{ImageError, LabelImage, inflate, read_exactly, voxel_count};

const FORMAT: &str = "INRIMAGE-4";
const MAGIC: &[u8] = b"#INRIMAGE-4#{";
const HEADER_BLOCK: usize = 256;
/// A header longer than this is not one: real ones take one or two blocks.
const MAX_HEADER_BLOCKS: usize = 64;

pub(super) fn read(bytes: &[u8]) -> Result<LabelImage, ImageError> {
    let (mut source, bound) = inflate(bytes);
    let mut header = Vec::new();
    for block in 0.. {
        if block == MAX_HEADER_BLOCKS {
            return Err(malformed(format!("no '##}}' within {} bytes; the header is damaged", header.len())));
        }
        header.extend(read_exactly(&mut *source, HEADER_BLOCK, bound, FORMAT)?);
        if !header.starts_with(MAGIC) {
            return Err(malformed("does not start with '#INRIMAGE-4#{'; it is another kind of file".into()));
        }
        if header.ends_with(b"##}\n") || header.ends_with(b"##}") {
            break;
        }
    }
    let header = Header::parse(&String::from_utf8_lossy(&header[MAGIC.len()..]))?;
    let count = voxel_count(header.dims).ok_or_else(|| {
        malformed(format!(
            "XDIM, YDIM, ZDIM = {:?}: all must be positive and their product at most {}",
            header.dims,
            super::MAX_VOXELS
        ))
    })?;
    let labels = read_exactly(&mut *source, count, bound, FORMAT)?;
    LabelImage::new(header.dims, header.spacing, Vector3::zeros(), labels)
}

struct Header {
    dims: [usize; 3],
    /// (m)
    spacing: [f64; 3],
}

impl Header {
    fn parse(text: &str) -> Result<Self, ImageError> {
        let mut dims = [None; 3];
        let mut spacing = [None; 3];
        for (number, line) in text.lines().enumerate() {
            let Some((key, value)) = line.split_once('=') else { continue };
            let (key, value) = (key.trim(), value.trim());
            let wrong = || malformed(format!("header line {}: {key}={value} cannot be read", number + 1));
            match key {
                "XDIM" => dims[0] = Some(value.parse().map_err(|_| wrong())?),
                "YDIM" => dims[1] = Some(value.parse().map_err(|_| wrong())?),
                "ZDIM" => dims[2] = Some(value.parse().map_err(|_| wrong())?),
                "VX" => spacing[0] = Some(value.parse::<f64>().map_err(|_| wrong())? * 1e-3),
                "VY" => spacing[1] = Some(value.parse::<f64>().map_err(|_| wrong())? * 1e-3),
                "VZ" => spacing[2] = Some(value.parse::<f64>().map_err(|_| wrong())? * 1e-3),
                "VDIM" if value != "1" => {
                    return Err(malformed(format!("VDIM={value}: a label image has one value per voxel")));
                }
                "TYPE" if value != "unsigned fixed" => {
                    return Err(malformed(format!("TYPE={value}: labels must be 'unsigned fixed'; convert the image")));
                }
                "PIXSIZE" if value.split_whitespace().next() != Some("8") => {
                    return Err(malformed(format!("PIXSIZE={value}: labels must have 8 bits; convert the image")));
                }
                _ => {}
            }
        }
        match (dims, spacing) {
            ([Some(x), Some(y), Some(z)], [Some(vx), Some(vy), Some(vz)]) => {
                Ok(Self { dims: [x, y, z], spacing: [vx, vy, vz] })
            }
            _ => Err(malformed("the header must state XDIM, YDIM, ZDIM, VX, VY and VZ".into())),
        }
    }
}

fn malformed(message: String) -> ImageError {
    ImageError::Malformed { format: FORMAT, message }
}
