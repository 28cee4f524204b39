//! The report of one step.

use super::{flags, record};

flags! {
    /// What a step met.
    StepFlags {
        /// Deadlines were missed since the step before.
        0 => OVERRUN;
        /// Contacts beyond the capacity were left out, the deepest kept.
        1 => CONTACTS_DROPPED;
        /// Conjugate gradients spent their iterations before reaching their tolerance.
        2 => FREE_MOTION_UNCONVERGED;
        /// The contact solver spent its sweeps before reaching its tolerance.
        3 => CONTACT_UNCONVERGED;
        /// This step's matrix was to be factored and could not be.
        4 => FACTOR_REFUSED;
        /// A body turned non-finite and was rolled back to its last good state.
        5 => ROLLED_BACK;
        /// There was no compliance: the step went on without contact.
        6 => NO_COMPLIANCE;
        /// The contact forces of Newton's method still changed when its passes were used up.
        7 => UNSETTLED;
        /// An event changed the body before this step.
        8 => CHANGED;
        /// The factor was of a body before an event and could not follow it: the step went on without contact unless its
        /// own matrix was factored.
        9 => FACTOR_OUTDATED;
        /// The tissue had passed through itself.
        10 => TANGLED;
        /// The body was led out of a tangle: it answered as linear elasticity in place of its law.
        11 => LED;
        /// The factor's copy in 16 bits could not serve: solves went by its stored values.
        12 => SOLVED_IN_FULL;
        /// The exact correction ended before reaching its tolerance.
        13 => CORRECTION_UNCONVERGED;
        /// A linear solve ended without convergence, and the step factored its own matrix to go on.
        14 => RESCUED;
        /// The comparison of a column of the compliance ended before reaching its tolerance, and says nothing.
        15 => SAMPLE_UNCONVERGED;
    }
}

record! {
    /// One step of the simulation: what each stage cost and how wrong it is.
    ///
    /// Durations are wall time and 0 in lockstep, where they would spoil repeatability.
    StepRecord = "Step" {
        /// Number of the step, from 0.
        1 => step: u64, "";
        /// Time since the start of the run at the begin of the step, when it took the pose of the tool (ns).
        2 => time_ns: u64, "ns";
        /// Step size (s).
        3 => dt: f64, "s";
        /// Assembly of forces and matrix (ns).
        4 => assembly_ns: u64, "ns";
        /// Free motion (ns).
        5 => free_motion_ns: u64, "ns";
        /// Detection (ns).
        6 => detection_ns: u64, "ns";
        /// Rows and compliance (ns).
        7 => compliance_ns: u64, "ns";
        /// Contact solver (ns).
        8 => solver_ns: u64, "ns";
        /// Correction (ns).
        9 => correction_ns: u64, "ns";
        /// Building and publishing the snapshot (ns).
        10 => snapshot_ns: u64, "ns";
        /// The whole step (ns).
        11 => total_ns: u64, "ns";
        /// Number of contacts.
        12 => contacts: u32, "";
        /// Iterations of the preconditioned conjugate gradients.
        13 => cg_iterations: u32, "";
        /// Their relative residual.
        14 => cg_residual: f64, "";
        /// Sweeps of the contact solver.
        15 => solver_sweeps: u32, "";
        /// Natural-map residual of the contact problem, relative.
        16 => solver_residual: f64, "";
        /// First row of the contact with the largest residual; -1 when there is none.
        17 => worst_row: i32, "";
        /// Epoch of the factor in use.
        18 => factor_epoch: u64, "";
        /// Age of its values (s).
        19 => factor_age: f64, "s";
        /// Contact force on the tool, world frame (N).
        20 => tool_force: [f64; 3], "N";
        /// Contact torque on the tool about its origin, world frame (N m).
        21 => tool_torque: [f64; 3], "N m";
        /// Elements with negative volume.
        22 => inverted_elements: u32, "";
        /// Elements whose tangent was filtered to be definite.
        23 => filtered_elements: u32, "";
        /// What the step met.
        24 => flags: StepFlags, "";
        /// Position of the tool that the step used (m).
        25 => tool_position: [f64; 3], "m";
        /// Its orientation `[x, y, z, w]`.
        26 => tool_orientation: [f64; 4], "";
        /// Relative error of the compliance along the contact forces; NaN where it was not measured.
        27 => compliance_error: f64, "";
        /// Relative error of the column of the compliance that was compared; NaN where none was.
        28 => sampled_error: f64, "";
        /// Its row.
        29 => sampled_row: u32, "";
        /// Iterations of the exact correction.
        30 => correction_iterations: u32, "";
        /// Deepest overlap that the correction left (m).
        31 => overlap: f64, "m";
        /// Halvings of the motion, by the guard of the linearised step or the line search of Newton's method.
        32 => cuts: u32, "";
        /// Contact solvers that were tried: above 1 where the first did not do, 0 without contact.
        33 => solver_attempts: u32, "";
        /// Events that had changed the body before this step.
        34 => phase: u32, "";
        /// Rung of the run's ladder of methods: 0 warped, 1 asynchronous, 2 with early refreshes, 3 exact; -1 without one.
        35 => rung: i32, "";
        /// The relative error of the contact forces that the rung below would have had; NaN where it was not measured.
        36 => lower_error: f64, "";
        /// Angle between the tool's jaws that the step used (rad); 0 for a tool without.
        37 => tool_opening: f64, "rad";
        /// The relative error of the contact forces, by what their laws miss and by the column that was compared: what an
        /// accuracy is held against. `None` where neither was measured, and in traces of before it was kept.
        38 => force_error: Option<f64>, "";
    }
}
