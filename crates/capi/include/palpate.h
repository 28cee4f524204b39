/* Palpate: real-time haptic simulation of soft tissue, for programs in C and C++.
 *
 * LIFE CYCLE
 *   palpate_create_from_file -> palpate_open_port -> palpate_start -> palpate_tick, palpate_tick, ...
 *   [palpate_pause, palpate_resume, palpate_change] -> palpate_stop -> palpate_close_port -> palpate_destroy
 *   A stopped simulation can be given a new port, and begins anew from rest. Port and simulation may be freed in either
 *   order; NULL may be freed. Every other use of a freed handle is an error that the library cannot see.
 *
 * THREADS
 *   The library owns the threads of the simulation: the tissue steps at some 30 Hz, its matrix is factored at some 10 Hz.
 *   The driver owns the thread that calls palpate_tick. palpate_tick allocates nothing, takes no lock and never waits:
 *   what a slow simulation does to it is an older model of the tissue, and in the end a force that fades. One thread
 *   ticks a port at a time; a second one gets PALPATE_STATUS_ERROR_BUSY and no force. All other functions may be called
 *   from any thread, beside the ticks, and may take long.
 *
 * FRAME AND UNITS
 *   SI units: m, s, N, N m, rad. Right-handed frames. Input and output of a tick are in the frame of the device, which
 *   stands in the world as palpate_options.origin and .axes say; what is for drawing (palpate_surface_...) is in the
 *   world. Forces and torques act ON THE HAND: pressing down on tissue gives a force that points up. Quaternions are
 *   w, x, y, z. A gripper is told as 0 closed to 1 open, and gets back the work of a whole opening (J), which the driver
 *   divides by the range of its device.
 *
 * SAFETY
 *   In this order: a pose, a number of the tissue's answer or a call that is not sound ends the force at once, and it
 *   comes back as a ramp; a pose that has jumped takes the force off until the tool is out of contact or back where it
 *   was; an old model of the tissue fades the force; a contact that has given out more energy than it took in is damped
 *   along the motion; force and torque are cut to their limits; the power that they give to the hand is cut to its limit;
 *   their change is cut to the slew rate. Whatever comes in, every output is finite, but for palpate_output.gap and .step_age,
 *   which may be +infinity. Limits act on what the library sends: a driver that does not call must rely on the watchdog
 *   of its own device.
 *
 * DEVICE
 *   A spring K and a damper B join the device and the tool. Where the scene has no [coupling], they follow from what the
 *   options tell of the device: its mass m, damping b, friction f, resolution d, and delay of n ticks of T seconds.
 *     B = least of 2 N s/m, max_damping, m / (4 (n + 1/2) T)
 *     K = least of 1000 N/m, max_stiffness / 2, and of these over 1.2:
 *         2 sqrt(b B) / ((n + 1/2) T), or (b + B) / ((n + 1/2) T) where b >= B;   2 f / d where f and d are known
 *   max_stiffness / 2 in proportion at a rate below that of the device's record. A device of which scene and options say
 *   nothing is the virtual one of the library: tell its own numbers.
 *
 * DRAWING
 *   Once: palpate_surface_counts, palpate_surface_triangles. In each picture: palpate_surface_positions. The library
 *   copies into the caller's memory; neither ticks nor steps wait for it. One thread draws at a time.
 *
 * VERSIONS
 *   Set struct_size to sizeof the struct before each struct is given to the library. Structs grow at their ends only; a
 *   program and a library of different versions exchange what both know. A switch or an input field that the library does
 *   not know is refused, and never left aside.
 *
 * ERRORS
 *   Negative: an error. palpate_last_error tells place and remedy, in the thread that made the call. No panic, no C++
 *   exception, no longjmp leaves the library.
 */


#ifndef PALPATE_H
#define PALPATE_H

/* Generated from crates/capi; do not edit: change the Rust and run `cargo xtask header`. */

#include <stdint.h>

/*
 The passivity layer keeps its account but does not act on the force.
 */
#define PALPATE_OPTION_OBSERVE_ENERGY_ONLY (1u << 0)

/*
 The force of a tick acts within it, whatever the scene says of the device's delay.
 */
#define PALPATE_OPTION_NO_DELAY (1u << 1)

/*
 Phase of a simulation that has a port and has not been started.
 */
#define PALPATE_PHASE_READY 0

/*
 The tissue moves.
 */
#define PALPATE_PHASE_RUNNING 1

/*
 The tissue stands still and gives no force.
 */
#define PALPATE_PHASE_PAUSED 2

/*
 Stopped.
 */
#define PALPATE_PHASE_STOPPED 3

/*
 Ended by itself: the body became non-finite or was torn apart, or a thread failed. palpate_stop, then
 palpate_last_error tell why.
 */
#define PALPATE_PHASE_FAILED 4

/*
 The field velocity and angular_velocity of the input are measured. Without it the library finds them from the poses.
 */
#define PALPATE_INPUT_VELOCITY (1u << 0)

/*
 The field gripper of the input is measured.
 */
#define PALPATE_INPUT_GRIPPER (1u << 1)

/*
 A new step of the tissue was taken over.
 */
#define PALPATE_TICK_NEW_STEP (1u << 0)

/*
 The tissue has not made a step yet: no force.
 */
#define PALPATE_TICK_NO_STEP (1u << 1)

/*
 The tissue stands still or has failed: the force comes down to zero.
 */
#define PALPATE_TICK_AT_REST (1u << 2)

/*
 The tissue's latest step is old: the force fades, or is zero.
 */
#define PALPATE_TICK_STALE (1u << 3)

/*
 The force is rising after a start or an interruption.
 */
#define PALPATE_TICK_FADE_IN (1u << 4)

/*
 The force was cut to its limit.
 */
#define PALPATE_TICK_FORCE_LIMITED (1u << 5)

/*
 The torque was cut to its limit.
 */
#define PALPATE_TICK_TORQUE_LIMITED (1u << 6)

/*
 The change of the force or torque was cut to its limit.
 */
#define PALPATE_TICK_SLEW_LIMITED (1u << 7)

/*
 A number of the tissue's answer was not finite: no force.
 */
#define PALPATE_TICK_NON_FINITE (1u << 8)

/*
 The time since the tick before was an interruption: the force comes back as a ramp.
 */
#define PALPATE_TICK_GAP (1u << 10)

/*
 The contact solver stopped above its tolerance.
 */
#define PALPATE_TICK_NOT_CONVERGED (1u << 11)

/*
 Contacts were left out because there was no room for them.
 */
#define PALPATE_TICK_TRUNCATED (1u << 12)

/*
 The input's pose, velocity or gripper was not finite, not a rotation, or beyond 1 km or 1e6 m/s: no force.
 */
#define PALPATE_TICK_BAD_POSE (1u << 13)

/*
 The tool has moved so far since the tissue's latest step that skin which the tick does not know could touch it unseen.
 */
#define PALPATE_TICK_BEYOND_PATCH (1u << 15)

/*
 The contact would have given out more energy than it took in: the force, or the gripper's torque, was reduced along the
 motion.
 */
#define PALPATE_TICK_PASSIVITY (1u << 16)

/*
 The power given to the hand was cut to its limit.
 */
#define PALPATE_TICK_POWER_LIMITED (1u << 17)

/*
 The tick came later than half a period after its time.
 */
#define PALPATE_TICK_LATE (1u << 18)

/*
 The device's pose has jumped: no force until the tool is out of contact or back where it was.
 */
#define PALPATE_TICK_JUMPED (1u << 19)

/*
 The device's clock stood still, ran backwards, leapt ahead, or did not keep pace: the library's own was used.
 */
#define PALPATE_TICK_CLOCK (1u << 30)

/*
 The call itself was refused: see the status.
 */
#define PALPATE_TICK_REFUSED (1u << 31)

/*
 What a function answers. Negative: an error; positive: information; 0: all is well.
 */
enum palpate_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /*
     Done.
     */
    PALPATE_STATUS_OK = 0,
    /*
     Done, and the flags of the output say something: the force fades, is limited, or there is none yet. Of
     palpate_change and palpate_stop: palpate_last_error has something to tell.
     */
    PALPATE_STATUS_NOTICE = 1,
    /*
     A pointer is NULL.
     */
    PALPATE_STATUS_ERROR_NULL = -1,
    /*
     The struct_size of a struct is too small for what every version of it holds.
     */
    PALPATE_STATUS_ERROR_STRUCT_SIZE = -2,
    /*
     A number is out of its range, a text is not UTF-8, or a bit or a reserved field is set that this library does not
     know.
     */
    PALPATE_STATUS_ERROR_ARGUMENT = -3,
    /*
     The scene cannot be read, or is wrong.
     */
    PALPATE_STATUS_ERROR_SCENE = -4,
    /*
     The scene cannot be set up: the body cannot be simulated, the trace not written, threads not started.
     */
    PALPATE_STATUS_ERROR_SET_UP = -5,
    /*
     The simulation is not in a phase in which the function may be called.
     */
    PALPATE_STATUS_ERROR_PHASE = -6,
    /*
     Another thread is inside palpate_tick with the same port. No force.
     */
    PALPATE_STATUS_ERROR_BUSY = -7,
    /*
     The pose, velocity or gripper of the input is not finite, not a rotation, or beyond 1 km or 1e6 m/s. No force.
     */
    PALPATE_STATUS_ERROR_INPUT = -8,
    /*
     A mistake inside the library. The port answers no force from then on.
     */
    PALPATE_STATUS_ERROR_INTERNAL = -9,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum palpate_status palpate_status;
#else
typedef int32_t palpate_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/*
 The driver's end of a simulation.
 */
typedef struct palpate_port palpate_port;

/*
 A scene made ready, with the threads that simulate it.
 */
typedef struct palpate_simulation palpate_simulation;

/*
 How a simulation is set up. Set everything to zero, then struct_size, then what you want to change: zero means "as
 the scene says", and where the scene says nothing, its default.
 */
typedef struct palpate_options {
    /*
     sizeof(palpate_options).
     */
    uint32_t struct_size;
    /*
     Worker threads of the step, at most 1024; 0: all cores. A driver that needs a core for itself leaves one free.
     */
    uint32_t threads;
    /*
     Rate at which the driver will call palpate_tick (Hz), 100 to 8000. The time between two ticks is measured; the
     rate tunes the coupling between device and tool.
     */
    double rate;
    /*
     Largest force of the device (N). No larger one is ever sent.
     */
    double max_force;
    /*
     Largest torque of the device (N m). Without one here and in the scene no torque is sent.
     */
    double max_torque;
    /*
     Largest stiffness that the device renders in a loop at 1 kHz (N/m).
     */
    double max_stiffness;
    /*
     Largest damping that the device renders in a loop at 1 kHz (N s/m).
     */
    double max_damping;
    /*
     Largest change of force (N/s).
     */
    double force_slew;
    /*
     Largest change of torque (N m/s).
     */
    double torque_slew;
    /*
     Time from no force to full force after a start and after every interruption (s).
     */
    double fade_in;
    /*
     Age of the tissue's latest step at which the force begins to fade (s).
     */
    double stale_after;
    /*
     Age at which the force is zero (s), above stale_after.
     */
    double stale_zero;
    /*
     Time between two ticks that counts as an interruption (s).
     */
    double gap;
    /*
     Where the origin of the device's frame lies in the world (m), -1000 to 1000. Refused where no axes are given.
     */
    double origin[3];
    /*
     Which way the device's x, y and z point in the world: 1, 2, 3 for x, y, z and -1, -2, -3 for the opposite. A
     right-handed frame. All zero: origin and axes are the scene's.
     */
    int32_t axes[3];
    /*
     Always 0.
     */
    uint32_t reserved;
    /*
     Trace to write (MCAP), UTF-8; NULL: none. Where it cannot be made, palpate_open_port fails.
     */
    const char *trace;
    /*
     Largest power that is given to the hand (W).
     */
    double max_power;
    /*
     Energy that a contact may give out beyond what it took in (J).
     */
    double energy_allowance;
    /*
     PALPATE_OPTION_... or 0. A bit that this library does not know is refused: it may be there for safety.
     */
    uint32_t switches;
    /*
     Always 0.
     */
    uint32_t reserved_switches;
    /*
     Apparent mass of the device where it is held (kg). It and the four after it describe the device, from which the
     coupling follows (DEVICE above); the damping that keeps a contact passive is bounded by the mass, too.
     */
    double device_mass;
    /*
     Viscous damping of the device itself (N s/m), with nobody holding it.
     */
    double device_damping;
    /*
     Coulomb friction of the device itself (N).
     */
    double device_friction;
    /*
     Smallest change of position that the device measures (m).
     */
    double device_resolution;
    /*
     Ticks from the return of palpate_tick to the effect of its force, at most 15. For none at all set
     PALPATE_OPTION_NO_DELAY.
     */
    uint32_t device_delay_ticks;
    /*
     Always 0.
     */
    uint32_t reserved_delay;
    /*
     Speed above which a motion of the device is no hand's (m/s); by default 5.
     */
    double jump_speed;
    /*
     Length of such a motion, in one tick or several, at which the pose is taken to have jumped (m); by default 0.02.
     */
    double jump_distance;
} palpate_options;

/*
 A simulation so far. Set struct_size before the call; the library fills in the rest.
 */
typedef struct palpate_statistics_data {
    /*
     sizeof(palpate_statistics_data).
     */
    uint32_t struct_size;
    /*
     One of PALPATE_PHASE_...
     */
    uint32_t phase;
    /*
     Time of the latest tick since the start (s).
     */
    double time;
    /*
     Steps of the tissue.
     */
    uint64_t steps;
    /*
     Factors that have reached the step.
     */
    uint64_t factors;
    /*
     Ticks.
     */
    uint64_t ticks;
    /*
     Periods that the step missed.
     */
    uint64_t step_overruns;
    /*
     Periods of the nominal rate that passed without a tick between two ticks.
     */
    uint64_t tick_overruns;
    /*
     Contacts that found no room in the scene's capacity.
     */
    uint64_t contacts_dropped;
    /*
     Ticks that were cut by a limit of force, torque, power or slew.
     */
    uint64_t limited;
    /*
     Ticks that sent no force because a number or a pose was not sound.
     */
    uint64_t refused;
    /*
     Steps per second over the last second.
     */
    double step_rate;
    /*
     Factors per second over the last second.
     */
    double factor_rate;
    /*
     Ticks per second over the last second.
     */
    double tick_rate;
    /*
     Work of a step: median, 99th percentile, largest (s).
     */
    double step_work[3];
    /*
     Work of a tick: median, 99th percentile, largest (s).
     */
    double tick_work[3];
    /*
     Largest force that was sent (N).
     */
    double largest_force;
    /*
     Largest jump of the contact force at a new step of the tissue (N).
     */
    double largest_jump;
    /*
     Age of the factor at the latest step (s).
     */
    double factor_age;
    /*
     Contacts that carry force at the latest step.
     */
    uint32_t contacts;
    /*
     Always 0.
     */
    uint32_t reserved;
    /*
     Ticks in which the force was cut to its limit.
     */
    uint64_t force_limited;
    /*
     Ticks in which the torque was cut to its limit.
     */
    uint64_t torque_limited;
    /*
     Ticks in which the power given to the hand was cut to its limit.
     */
    uint64_t power_limited;
    /*
     Ticks in which the change of force or torque was cut to its limit.
     */
    uint64_t slew_limited;
    /*
     Ticks in which the passivity layer reduced the force along the motion.
     */
    uint64_t passivity;
    /*
     Ticks whose step of the tissue was old, so that the force faded or was zero.
     */
    uint64_t stale;
    /*
     Ticks after an interruption.
     */
    uint64_t gaps;
    /*
     Ticks that came later than half a period after their time.
     */
    uint64_t late;
    /*
     Ticks without force since the device's pose had jumped.
     */
    uint64_t jumped;
    /*
     Energy that went through the device by forces since the start (J); positive: the hand has put it in.
     */
    double energy;
    /*
     The same by torques (J).
     */
    double energy_by_torque;
    /*
     Lowest energy of a contact (J): what it gave out beyond what it had taken in.
     */
    double lowest_energy;
    /*
     Relative error of the compliance that the latest step measured; NaN where it measured none.
     */
    double compliance_error;
    /*
     Relative error of the contact forces of the latest step, as far as it is known; NaN where it is not.
     */
    double force_error;
    /*
     Deepest overlap that the correction of the latest step left (m).
     */
    double overlap;
    /*
     Conjugate-gradient iterations of the latest step: of free motion and correction.
     */
    uint32_t iterations;
    /*
     Always 0.
     */
    uint32_t reserved_too;
    /*
     Ticks with more contacts than there was room for: the force was that of the deepest.
     */
    uint64_t truncated;
    /*
     Ticks whose contact problem ended above its tolerance.
     */
    uint64_t not_converged;
} palpate_statistics_data;

/*
 What the device measured, in its own frame.
 */
typedef struct palpate_input {
    /*
     sizeof(palpate_input).
     */
    uint32_t struct_size;
    /*
     PALPATE_INPUT_... of what is measured beyond the pose, or 0. A bit that this library does not know is refused.
     */
    uint32_t fields;
    /*
     Time of the measurement on the device's clock, which does not run backwards (ns). 0: the device has no clock, and
     the time of the call counts. Force and fades change no faster than both clocks allow, so call at even times.
     */
    uint64_t time_ns;
    /*
     Position of the end effector (m).
     */
    double position[3];
    /*
     Orientation of the end effector: a quaternion w, x, y, z of length 1. Four zeros: not turned, for devices that
     measure no orientation.
     */
    double orientation[4];
    /*
     Velocity (m/s).
     */
    double velocity[3];
    /*
     Angular velocity (rad/s).
     */
    double angular_velocity[3];
    /*
     Switches, one bit each.
     */
    uint32_t buttons;
    /*
     Always 0.
     */
    uint32_t reserved;
    /*
     How far the gripper is open: 0 closed, 1 open. Counts only with PALPATE_INPUT_GRIPPER; without it the gripper is
     open.
     */
    double gripper;
} palpate_input;

/*
 What a tick answers, in the device's frame. Set struct_size once; the library fills in the rest at every call.
 */
typedef struct palpate_output {
    /*
     sizeof(palpate_output).
     */
    uint32_t struct_size;
    /*
     PALPATE_TICK_... of what happened.
     */
    uint32_t flags;
    /*
     Number of the tick since the start.
     */
    uint64_t tick;
    /*
     Force on the hand, for the motors (N): after all limits, zero after every error.
     */
    double force[3];
    /*
     Torque on the hand about the tool's origin, for the motors (N m).
     */
    double torque[3];
    /*
     Contact force before limits and fades (N).
     */
    double contact_force[3];
    /*
     Position of the tool behind the coupling, on the skin where there is contact (m): what to draw.
     */
    double tool_position[3];
    /*
     Its orientation: quaternion w, x, y, z.
     */
    double tool_orientation[4];
    /*
     Smallest gap between tool and skin (m); +infinity where none is watched.
     */
    double gap;
    /*
     Share of the contact force that is let through, 0 to 1.
     */
    double gain;
    /*
     Age of the tissue's latest step (s); +infinity before the first, and where the call is refused.
     */
    double step_age;
    /*
     Time since the tick before that the force was given to change (s): no more than the device's clock says, nor the
     library's.
     */
    double dt;
    /*
     Work of this tick (s).
     */
    double work;
    /*
     Contacts that carry force.
     */
    uint32_t contacts;
    /*
     One of PALPATE_PHASE_...; where port is NULL, or a mistake inside the library has ended it, PALPATE_PHASE_FAILED.
     */
    uint32_t phase;
    /*
     Energy that went through the port in the contact that lasts (J); positive: the hand has put it in.
     */
    double energy;
    /*
     Contact torque about the tool's origin, before limits and fades (N m).
     */
    double contact_torque[3];
    /*
     Force on the gripper, for its motor, after all limits, as the work of a whole opening from closed to open (J):
     divide by the range of the device's gripper, in rad for a torque in N m, in m for a force in N. Positive opens.
     */
    double gripper_effort;
    /*
     Torque on the angle between the tool's jaws, after all limits (N m); positive opens.
     */
    double gripper_torque;
    /*
     Angle between the tool's jaws behind the coupling (rad): what to draw. 0 for a tool without.
     */
    double tool_opening;
} palpate_output;

/*
 The bodies of a simulation at a step. Set struct_size before the call; the library fills in the rest.
 */
typedef struct palpate_surface {
    /*
     sizeof(palpate_surface).
     */
    uint32_t struct_size;
    /*
     Events and changes by palpate_change that had happened: with each of them the triangles change, and nothing else
     changes them.
     */
    uint32_t events;
    /*
     Steps so far.
     */
    uint64_t steps;
    /*
     Time of the end of the latest (s).
     */
    double time;
    /*
     Nodes of the soft body, those inside it too. Does not change.
     */
    uint64_t nodes;
    /*
     Triangles of its surface.
     */
    uint64_t triangles;
    /*
     Rigid bodies, in the order of the scene. Does not change.
     */
    uint64_t rigid_bodies;
} palpate_surface;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 Version of the library, such as "0.1.0".
 */
const char *palpate_version(void);

/*
 What a status means, as a sentence. Never NULL; any number may be given.
 */
const char *palpate_status_text(int32_t status);

/*
 Why the last call in this thread failed, with place and remedy. Never NULL; empty before the first failure. Valid
 until the next call that fails in this thread. palpate_tick does not write it: its status and flags say all.
 */
const char *palpate_last_error(void);

/*
 Reads a scene file, or the bundled scene of this name where no such file exists ("block", "liver"), and makes its
 body ready. Takes as long as the scene needs for a mesh from an image: seconds.

 `options` may be NULL. `*out` is NULL after an error.

 The caller answers for this:
 `scene` is NULL or a text closed by a zero; `options` NULL or a struct whose struct_size is right; `out` NULL or
 writable.
 */
palpate_status palpate_create_from_file(const char *scene,
                                        const struct palpate_options *options,
                                        struct palpate_simulation **out);

/*
 The same from the text of a scene (TOML). Files that it names are looked for in `folder`; NULL: the working folder.

 The caller answers for this:
 As palpate_create_from_file, for `scene` and `folder`.
 */
palpate_status palpate_create_from_string(const char *scene,
                                          const char *folder,
                                          const struct palpate_options *options,
                                          struct palpate_simulation **out);

/*
 Opens the port through which a driver ticks, with the body settled at rest; there is one at a time. After
 palpate_stop another one can be opened, and the scene begins anew.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `out` NULL or writable.
 */
palpate_status palpate_open_port(const struct palpate_simulation *simulation,
                                 struct palpate_port **out);

/*
 Starts the threads of a simulation that has a port.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed.
 */
palpate_status palpate_start(const struct palpate_simulation *simulation);

/*
 Halts the tissue; the force comes down to zero within the limits. The driver goes on ticking.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed.
 */
palpate_status palpate_pause(const struct palpate_simulation *simulation);

/*
 Lets the tissue go on after palpate_pause; the force comes back as a ramp.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed.
 */
palpate_status palpate_resume(const struct palpate_simulation *simulation);

/*
 Changes the body while it runs: nodes released or held, elements removed. `change` is TOML with the keys of an event
 of a scene without `time`, such as "remove = { ball = { center = [0.02, 0.02, 0.04], radius = 0.005 } }" or
 "hold = { node_set = \"x_min\" }". The scene's body must have room: `changes = 8` for eight changes in one run.

 The changed body is made on the calling thread, in some ten milliseconds per thousand nodes, so do not call it from the
 thread that ticks; the tissue goes on meanwhile, and its next step takes the change, or where the scene has events the
 first step after the last of them. Other calls with the same simulation wait until it is made, ticks do not.
 PALPATE_STATUS_NOTICE where it waits for an event, PALPATE_STATUS_ERROR_PHASE where nothing runs,
 PALPATE_STATUS_ERROR_ARGUMENT where the change cannot be done; palpate_last_error says why.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `change` is NULL or a text closed by a zero.
 */
palpate_status palpate_change(const struct palpate_simulation *simulation,
                              const char *change);

/*
 Ends the threads and the trace, and waits for them: at most the time of a step and 0.1 s. The driver may go on
 ticking meanwhile and afterwards; the force comes down to zero within the limits. PALPATE_STATUS_NOTICE where the body
 has failed or the trace is not whole; palpate_last_error tells.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed.
 */
palpate_status palpate_stop(const struct palpate_simulation *simulation);

/*
 Counts, rates and tails so far, at most some 50 ms old. Any thread may ask at any time.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `out` NULL or a struct whose struct_size is right.
 */
palpate_status palpate_statistics(const struct palpate_simulation *simulation,
                                  struct palpate_statistics_data *out);

/*
 Stops the simulation and frees it. Its port stays: its ticks send no force once the present one has come down, and
 palpate_close_port frees it. NULL is allowed.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed, and no other thread uses it.
 */
palpate_status palpate_destroy(struct palpate_simulation *simulation);

/*
 One tick: from what the device measured to the force for its motors.

 Call it from one thread of the driver, at 100 Hz to 8 kHz. It allocates nothing, waits for nothing, and asks the
 system for the time alone. `output` is filled whatever happens, as far as its struct_size reaches; after an error its
 force and torque are zero.

 The caller answers for this:
 `port` is NULL or was opened and not closed; `input` and `output` are NULL or structs whose struct_size is right.
 */
palpate_status palpate_tick(const struct palpate_port *port,
                            const struct palpate_input *input,
                            struct palpate_output *output);

/*
 Frees a port, whether its simulation still lives or not. NULL is allowed.

 The caller answers for this:
 `port` is NULL or was opened and not closed, and no thread ticks with it.
 */
palpate_status palpate_close_port(struct palpate_port *port);

/*
 Asks for a real-time priority for the calling thread, which is to tick. PALPATE_STATUS_NOTICE where the system does
 not grant it; palpate_last_error tells the remedy.
 */
palpate_status palpate_raise_priority(void);

/*
 How many nodes, triangles and rigid bodies there are, and at which step they are. Of a simulation that has a port.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `out` NULL or a struct whose struct_size is right.
 */
palpate_status palpate_surface_counts(const struct palpate_simulation *simulation,
                                      struct palpate_surface *out);

/*
 Copies where the nodes of the soft body are after the latest step: x, y, z of each, in the world (m). `room` is the
 number of nodes that `positions` has room for, at least palpate_surface.nodes. Neither a tick nor a step waits for it.
 `out` may be NULL; it tells which step this is, and where its events are not those that the triangles were copied
 for, to copy them anew.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `positions` has room for 3 `room` numbers; `out` NULL or a
 struct whose struct_size is right.
 */
palpate_status palpate_surface_positions(const struct palpate_simulation *simulation,
                                         double *positions,
                                         uint64_t room,
                                         struct palpate_surface *out);

/*
 Copies the triangles of the soft body's surface after this number of events, changes by palpate_change among them:
 three nodes each, counted from 0, counter-clockwise from outside. Of a simulation that has a port. `room` is the
 number of triangles that `triangles` has room for, at least palpate_surface.triangles.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `triangles` has room for 3 `room` numbers.
 */
palpate_status palpate_surface_triangles(const struct palpate_simulation *simulation,
                                         uint32_t events,
                                         uint32_t *triangles,
                                         uint64_t room);

/*
 Copies where the rigid bodies are after the latest step, in the world: seven numbers each, the origin x, y, z of its
 shape (m) and a quaternion w, x, y, z. `room` is the number of bodies that `poses` has room for.

 The caller answers for this:
 `simulation` is NULL or was created and not destroyed; `poses` has room for 7 `room` numbers; `out` NULL or a struct
 whose struct_size is right.
 */
palpate_status palpate_rigid_poses(const struct palpate_simulation *simulation,
                                   double *poses,
                                   uint64_t room,
                                   struct palpate_surface *out);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
