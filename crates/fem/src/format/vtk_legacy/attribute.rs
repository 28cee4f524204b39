//! Arrays of points, of cells and of the whole file.

use super::{Owner, Reader};
use crate::format::scalar::{Endian, Scalar, Values};
use crate::format::vtk_arrays::{is_known_field, is_region_array};
use crate::mesh::MeshError;

impl Reader<'_> {
    /// What follows a keyword that is none of the geometry.
    pub(super) fn read_attribute(&mut self, keyword: &str) -> Result<(), MeshError> {
        match keyword {
            "POINT_DATA" | "CELL_DATA" => {
                self.owner = if keyword == "CELL_DATA" { Owner::Cells } else { Owner::Points };
                self.owned = self.cursor.number("the length of arrays")?;
                Ok(())
            }
            "FIELD" => {
                self.cursor.expect_word("the name of a field")?;
                for _ in 0..self.cursor.count("the number of arrays", 4)? {
                    // Metadata of one array may stand before the next.
                    while self.cursor.peek() == Some(b"METADATA") {
                        self.skip_metadata();
                    }
                    let name = self.name()?;
                    let components = self.cursor.number::<u64>("the number of components")?;
                    let tuples = self.cursor.number::<u64>("the number of tuples")?;
                    let scalar = self.scalar()?;
                    self.read_array(&name, tuples, components, scalar)?;
                }
                Ok(())
            }
            "SCALARS" => self.read_scalars(),
            "VECTORS" | "NORMALS" => self.read_fixed(3),
            "TENSORS" => self.read_fixed(9),
            "TENSORS6" => self.read_fixed(6),
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => self.read_fixed(1),
            "TEXTURE_COORDINATES" => {
                let name = self.name()?;
                let components = self.cursor.number("the number of components")?;
                let scalar = self.scalar()?;
                self.read_array(&name, self.owned as u64, components, scalar)
            }
            "COLOR_SCALARS" => {
                let name = self.name()?;
                let components = self.cursor.number("the number of components")?;
                self.read_array(&name, self.owned as u64, components, self.colour())
            }
            "LOOKUP_TABLE" => {
                let name = self.name()?;
                let size = self.cursor.number("the size of a table")?;
                self.read_array(&name, size, 4, self.colour())
            }
            _ => Err(self.cursor.syntax(format!("unknown keyword {:?}", keyword.chars().take(24).collect::<String>()))),
        }
    }

    /// Colours are bytes in binary files and fractions in text.
    fn colour(&self) -> Scalar {
        if self.binary { Scalar::U8 } else { Scalar::F32 }
    }

    fn read_fixed(&mut self, components: u64) -> Result<(), MeshError> {
        let name = self.name()?;
        let scalar = self.scalar()?;
        self.read_array(&name, self.owned as u64, components, scalar)
    }

    /// Name, type and perhaps the number of components on one line; then perhaps the name of a table.
    fn read_scalars(&mut self) -> Result<(), MeshError> {
        let name = self.name()?;
        let scalar = self.scalar()?;
        let mut ahead = self.cursor.clone();
        let mut components = 1;
        let line = ahead.line();
        if !line.trim_ascii().is_empty() {
            components = self.cursor.number("the number of components")?;
        }
        if self.cursor.peek() == Some(b"LOOKUP_TABLE") {
            self.cursor.keyword("LOOKUP_TABLE")?;
            self.name()?;
        }
        self.read_array(&name, self.owned as u64, components, scalar)
    }

    /// A name, in which VTK writes bytes such as spaces as %20.
    fn name(&mut self) -> Result<String, MeshError> {
        let word = self.cursor.expect_word("a name")?.as_bytes();
        let mut name = Vec::with_capacity(word.len());
        let mut rest = word;
        while let Some((&byte, others)) = rest.split_first() {
            let code = others.get(..2).and_then(|code| std::str::from_utf8(code).ok());
            let code = code.and_then(|code| u8::from_str_radix(code, 16).ok());
            match (byte, code) {
                (b'%', Some(decoded)) => {
                    name.push(decoded);
                    rest = &others[2..];
                }
                _ => {
                    name.push(byte);
                    rest = others;
                }
            }
        }
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    /// Keeps arrays that tell of regions and node sets, and passes over others.
    fn read_array(&mut self, name: &str, tuples: u64, components: u64, scalar: Scalar) -> Result<(), MeshError> {
        let Some(count) = tuples.checked_mul(components) else {
            return Err(self.cursor.syntax(format!("the array {name:?} has {tuples} x {components} numbers")));
        };
        let wanted = match self.owner {
            Owner::Cells => components == 1 && is_region_array(name),
            Owner::Field => is_known_field(name),
            Owner::Points => false,
        };
        if !wanted {
            if self.binary {
                self.binary_values(count, 1, scalar, "an array")?;
            } else {
                for _ in 0..count {
                    self.cursor.number::<f64>("a number of an array")?;
                }
            }
            return Ok(());
        }
        let is_float = matches!(scalar, Scalar::F32 | Scalar::F64);
        let values = match (is_float, self.binary) {
            (false, _) => Values::Ints(self.ints(count, scalar, name, None)?),
            (true, true) => {
                let bytes = self.binary_values(count, 1, scalar, name)?;
                Values::Floats(scalar.floats(bytes, Endian::Big).collect())
            }
            (true, false) => {
                let count = self.cursor.check_count(count, "the length of an array", 2)?;
                Values::Floats((0..count).map(|_| self.cursor.number("a number")).collect::<Result<_, _>>()?)
            }
        };
        match self.owner {
            Owner::Cells => self.arrays.keep_cell_data(name, values),
            _ => self.arrays.keep_field_data(name, values),
        }
        Ok(())
    }
}
