//! Problems of the Frictional Contact Library (HDF5), read only.
//!
//! Layout after `fclib.h` and `fclib.c` of FCLIB 3 (<https://github.com/FrictionalContactLibrary/fclib>):
//! `/fclib_local` holds `spacedim` (3), the matrix `W`, and `vectors/q` and `vectors/mu`; `/solution/r` and
//! `/guesses/1/r` hold forces where there are any. A matrix is a group of `m`, `n`, `nzmax`, `nz`, `p`, `i` and `x`:
//! `nz` entries as triplets (rows in `p`, columns in `i`), compressed columns where `nz` is -1, compressed rows where
//! it is -2. `q` is our `delta_free`, `W` our `W`, the normal row comes first in each contact, as in the text files of
//! Siconos. Values may be of any unit.
//!
//! Not read: plane problems, and `V` and `R` (bilateral rows beside `W`). Global problems (`/fclib_global`) hold no
//! `W`, and writers disagree on which of `p` and `i` of the triplets of their unsymmetric `H` are the rows; condense
//! them to a local one first.

use super::{Forces, MAX_ROWS, ProblemFileError};
use crate::problem::ConstraintProblem;
use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::{H5Type, Hdf5File, OpenOptions};
use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Coulomb, Law};

/// Bytes of the largest array that is read: the entries of the largest matrix.
const MAX_BYTES: usize = MAX_ROWS * MAX_ROWS * size_of::<f64>();

/// Reads the bytes of an HDF5 file: the problem, and the solution and first guess where there are any.
///
/// # Errors
/// What is missing, of another kind, or does not fit, by its path in the file.
pub fn read(bytes: Vec<u8>) -> Result<(ConstraintProblem, Forces), ProblemFileError> {
    let options = OpenOptions::default().with_max_read_bytes(MAX_BYTES).with_max_chunk_bytes(MAX_BYTES);
    let damaged = |error: Error| wrong(format!("{error}; the file is damaged or was cut off, write it again"));
    let file = Hdf5File::from_vec_with_options(bytes, options).map_err(damaged)?;
    let root = Node { group: file.root_group().map_err(damaged)?, path: String::new() };
    let Some(local) = root.child("fclib_local")? else {
        let global = root.child("fclib_global")?.is_some();
        return Err(wrong(match global {
            true => "/fclib_global, a problem without W, is not read; condense it to a local one with Siconos".into(),
            false => "no /fclib_local in it: not a file of FCLIB".into(),
        }));
    };
    match local.single("spacedim")? {
        3 => {}
        2 => return Err(wrong("/fclib_local/spacedim is 2: plane problems are not read".into())),
        other => return Err(wrong(format!("/fclib_local/spacedim is {other}; it must be 3"))),
    }
    for name in ["V", "R"] {
        if local.child(name)?.is_some() {
            return Err(wrong(format!(
                "/fclib_local/{name}: bilateral rows beside W are not read; eliminate them first"
            )));
        }
    }
    let w = matrix(&local.required("W")?)?;
    let rows = w.nrows();
    let vectors = local.required("vectors")?;
    let q = DVector::from_vec(vectors.array("q", Some(rows))?);
    if rows % 3 != 0 {
        return Err(wrong(format!("/fclib_local/W has {rows} rows, which are not three per contact")));
    }
    let friction: Vec<f64> = vectors.array("mu", Some(rows / 3))?;
    let problem = ConstraintProblem::new(w, q, friction.into_iter().map(|friction| Law::from(Coulomb { friction })))?;
    let lambda = root.child("solution")?.map(|solution| solution.array("r", Some(rows))).transpose()?;
    let guess = root.child("guesses")?.map(|guesses| guesses.child("1")).transpose()?.flatten();
    let start = guess.map(|guess| guess.array("r", Some(rows))).transpose()?;
    let forces = Forces { start, lambda };
    forces.check(rows)?;
    Ok((problem, forces))
}

fn wrong(what: String) -> ProblemFileError {
    ProblemFileError::Fclib { what }
}

/// A group and where it is.
struct Node {
    group: Group,
    path: String,
}

impl Node {
    fn child(&self, name: &str) -> Result<Option<Node>, ProblemFileError> {
        let path = format!("{}/{name}", self.path);
        match self.group.group(name) {
            Ok(group) => Ok(Some(Node { group, path })),
            Err(Error::GroupNotFound(_)) => Ok(None),
            Err(error) => Err(wrong(format!("{path}: {error}"))),
        }
    }

    fn required(&self, name: &str) -> Result<Node, ProblemFileError> {
        self.child(name)?.ok_or_else(|| wrong(format!("no {}/{name}, which every problem has", self.path)))
    }

    /// All numbers of a data set, as many as `expected` where that is known.
    fn array<T: H5Type>(&self, name: &str, expected: Option<usize>) -> Result<Vec<T>, ProblemFileError> {
        let fault = |what: String| wrong(format!("{}/{name}: {what}", self.path));
        let values = self.group.dataset(name).and_then(|data| data.read_array::<T>());
        let values = values.map_err(|error| fault(error.to_string()))?.into_iter().collect::<Vec<T>>();
        match expected {
            Some(expected) if values.len() != expected => {
                Err(fault(format!("{} numbers where there should be {expected}", values.len())))
            }
            _ => Ok(values),
        }
    }

    fn single(&self, name: &str) -> Result<i32, ProblemFileError> {
        Ok(self.array(name, Some(1))?[0])
    }

    /// Whole numbers within `range`.
    fn indices(&self, name: &str, expected: Option<usize>, end: usize) -> Result<Vec<usize>, ProblemFileError> {
        let index = |value: i32| {
            let index = usize::try_from(value).ok().filter(|index| *index < end);
            index.ok_or_else(|| {
                wrong(format!("{}/{name}: {value} is not within 0 to {}", self.path, end.saturating_sub(1)))
            })
        };
        self.array(name, expected)?.into_iter().map(index).collect()
    }
}

/// A square matrix; entries that are given more than once add up.
fn matrix(node: &Node) -> Result<DMatrix<f64>, ProblemFileError> {
    let (m, n) = (node.single("m")?, node.single("n")?);
    let rows = match usize::try_from(m) {
        Ok(rows) if m == n => rows,
        _ => return Err(wrong(format!("{} has {m} rows and {n} columns; it must be square", node.path))),
    };
    if rows > MAX_ROWS {
        return Err(ProblemFileError::TooLarge { rows });
    }
    let nz = node.single("nz")?;
    let values: Vec<f64> = node.array("x", None)?;
    let mut w = DMatrix::zeros(rows, rows);
    match nz {
        0.. => {
            let entries = nz as usize;
            let p = node.indices("p", Some(entries), rows)?;
            let i = node.indices("i", Some(entries), rows)?;
            if values.len() < entries {
                return Err(wrong(format!("{}/x: {} numbers for {entries} entries", node.path, values.len())));
            }
            for ((row, column), value) in p.into_iter().zip(i).zip(values) {
                w[(row, column)] += value;
            }
        }
        -1 | -2 => {
            let starts = node.indices("p", Some(rows + 1), values.len() + 1)?;
            let across = node.indices("i", None, rows)?;
            for (along, ends) in starts.windows(2).enumerate() {
                let (Some(across), Some(values)) = (across.get(ends[0]..ends[1]), values.get(ends[0]..ends[1])) else {
                    return Err(wrong(format!("{}/p: {} to {} are not entries of i", node.path, ends[0], ends[1])));
                };
                for (&across, &value) in across.iter().zip(values) {
                    w[if nz == -1 { (across, along) } else { (along, across) }] += value;
                }
            }
        }
        other => return Err(wrong(format!("{}/nz is {other}: no kind of matrix; it must be -2 or more", node.path))),
    }
    Ok(w)
}
