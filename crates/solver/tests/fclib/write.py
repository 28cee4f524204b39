"""Writes the files beside it with the HDF5 library, data set by data set as FCLIB's fclib_write_local and _solution do.

Needs h5py; `python3 write.py` in this folder. tests/fclib_files.rs computes the same numbers.
"""
import h5py
import numpy as np

CONTACTS = 4
ROWS = 3 * CONTACTS
i, j = np.indices((ROWS, ROWS))
W = np.where(abs(i - j) < 5, 1.0 / (1.0 + abs(i - j)), 0.0) + 2.0 * (i == j)
Q = np.array([(-1.0 if k % 3 == 0 else 0.25) / (1.0 + k) for k in range(ROWS)])
MU = np.array([0.1 * (k + 1) for k in range(CONTACTS)])
R = np.array([1.0 / (3.0 + k) for k in range(ROWS)])


def integers(group, name, values):
    group.create_dataset(name, data=np.array(values, dtype=np.int32).reshape(-1))


def matrix(group, w, kind):
    rows, columns = np.nonzero(w)
    if kind == "columns":
        columns, rows = np.nonzero(w.T)
    integers(group, "nzmax", len(rows))
    integers(group, "m", w.shape[0])
    integers(group, "n", w.shape[1])
    integers(group, "nz", {"triplets": len(rows), "columns": -1, "rows": -2}[kind])
    along, across = (columns, rows) if kind == "columns" else (rows, columns)
    starts = np.concatenate([[0], np.cumsum(np.bincount(along, minlength=w.shape[0]))])
    integers(group, "p", rows if kind == "triplets" else starts)
    integers(group, "i", across)
    group.create_dataset("x", data=w[rows, columns])
    group.create_dataset("conditioning", data=np.array([1.0]))
    group.create_dataset("determinant", data=np.array([1.0]))
    integers(group, "rank", w.shape[0])


def local(name, kind, spacedim=3, libver="earliest", extra=()):
    with h5py.File(name, "w", libver=libver) as file:
        problem = file.create_group("fclib_local")
        integers(problem, "spacedim", spacedim)
        matrix(problem.create_group("W"), W, kind)
        for further in extra:
            matrix(problem.create_group(further), W, kind)
        vectors = problem.create_group("vectors")
        vectors.create_dataset("q", data=Q)
        vectors.create_dataset("mu", data=MU)
        info = problem.create_group("info")
        info.create_dataset("title", data=np.bytes_("four contacts"))
        if kind == "rows":
            solution = file.create_group("solution")
            solution.create_dataset("u", data=W @ R + Q)
            solution.create_dataset("r", data=R)
            guess = file.create_group("guesses").create_group("1")
            guess.create_dataset("u", data=Q)
            guess.create_dataset("r", data=0.5 * R)


local("triplets.hdf5", "triplets")
local("columns.hdf5", "columns")
local("rows.hdf5", "rows")
local("latest.hdf5", "rows", libver="latest")
local("plane.hdf5", "rows", spacedim=2)
local("bilateral.hdf5", "rows", extra=("V", "R"))
with h5py.File("global.hdf5", "w", libver="earliest") as file:
    integers(file.create_group("fclib_global"), "spacedim", 3)
