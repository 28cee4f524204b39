//! The tick's loop body, the same on the real-time thread and in lockstep.

use crate::device::{HapticDevice, TickTime};
use crate::exchange::Reader;
use crate::record::{TickFlags, TickRecord};
use crate::snapshot::HapticSnapshot;
use crate::tick::{Tick, TickState, TickWorkspace};
use crate::wrench::Wrench;

/// Reads the device, takes the latest snapshot, ticks, and writes the wrench.
///
/// `time.dt` is the time since the last call as measured, or the period in lockstep. A device that does not answer
/// gets a zero wrench; the record names the error. But for the device's own calls it is as bounded and as
/// quiet as [`Tick::tick`].
pub fn run_tick(
    tick: &Tick,
    state: &mut TickState,
    ws: &mut TickWorkspace,
    snapshots: &mut Reader<HapticSnapshot>,
    device: &mut dyn HapticDevice,
    time: TickTime,
) -> TickRecord {
    let sample = match device.read(time) {
        Ok(sample) => sample,
        Err(error) => {
            // The read error is the one to report; a write that fails too says nothing new.
            device.write_gripper(0.0);
            let _ = device.write(Wrench::zero());
            snapshots.refresh();
            return tick.idle(state, snapshots.current(), time, error);
        }
    };
    if snapshots.has_new() {
        tick.weigh_outgoing(state, snapshots.current(), &sample, ws);
        snapshots.refresh();
    }
    let mut record = tick.tick(state, snapshots.current(), &sample, time, ws);
    device.write_gripper(record.gripper.effort);
    if let Err(error) = device.write(record.wrench) {
        state.cut();
        record.flags.set(TickFlags::DEVICE_ERROR);
        record.device_error = Some(error);
        record.wrench = Wrench::zero();
        (record.gripper.torque, record.gripper.effort) = (0.0, 0.0);
        record.gain = 0.0;
    } else {
        record.flags.set(device.limited());
    }
    record
}
