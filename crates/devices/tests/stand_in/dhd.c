/* A stand-in for Force Dimension's DHD library: the functions that the driver calls, over a device in arithmetic only.
 *
 * The device is a mass on a spring to a hand; each command of a force moves it by a millisecond. Functions that begin with
 * stand_in_ are the test's, to move the hand and to pull the plug; where the library is loaded by another program, the
 * environment says where the hand goes (STAND_IN_HAND, "x y z" in m), of which type it is (STAND_IN_TYPE), after how many poses
 * the plug is pulled (STAND_IN_UNPLUG), and the largest force along an axis that does not saturate a motor (STAND_IN_SATURATED,
 * in N).
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

static const double MASS = 0.1, DAMPING = 6.0, STIFFNESS = 350.0, DT = 1e-3;

static int devices = 1;     /* connected */
static int open_count = 0;  /* open by this program */
static int unplugged = 0;
static int last_error = 0;
static int system_type = 33; /* DHD_DEVICE_OMEGA3 */
static int forces_enabled = 0;
static int watchdog = 0;      /* units of 125 us */
static int has_watchdog = 1;
static int calls = 0;
static int unplug_after = -1;
static double gripper_force, saturated_above = 12.0;
static double position[3], velocity[3], hand[3], force[3], torque[3];

void stand_in_devices(int n) { devices = n; }
void stand_in_unplug(int on) { unplugged = on; }
void stand_in_type(int type) { system_type = type; }
void stand_in_hand(double x, double y, double z) { hand[0] = x; hand[1] = y; hand[2] = z; }
int stand_in_open(void) { return open_count; }
int stand_in_enabled(void) { return forces_enabled; }
int stand_in_watchdog(void) { return watchdog; }
void stand_in_has_watchdog(int has) { has_watchdog = has; }
/* What the firmware does after a silence. */
void stand_in_bite(int on) { if (on) forces_enabled = 0; }
void stand_in_force(double *out)
{
    for (int i = 0; i < 3; i++) {
        out[i] = force[i];
        out[3 + i] = torque[i];
    }
}

/* In thousandths of a newton. */
int stand_in_gripper(void) { return (int)lround(1e3 * gripper_force); }

static int fail(int code)
{
    last_error = code;
    return -1;
}

static int gone(void) { return unplugged || open_count == 0; }

int dhdGetDeviceCount(void) { return devices; }

int dhdOpen(void)
{
    if (devices < 1) return fail(5); /* DHD_ERROR_NO_DEVICE_FOUND */
    open_count++;
    const char *text = getenv("STAND_IN_HAND");
    if (text != NULL) sscanf(text, "%lf %lf %lf", &hand[0], &hand[1], &hand[2]);
    text = getenv("STAND_IN_TYPE");
    if (text != NULL) system_type = atoi(text);
    text = getenv("STAND_IN_UNPLUG");
    if (text != NULL) unplug_after = atoi(text);
    text = getenv("STAND_IN_SATURATED");
    if (text != NULL) saturated_above = atof(text);
    return 0;
}

int dhdClose(char id)
{
    (void)id;
    if (open_count < 1) return fail(5);
    open_count--;
    return 0;
}

int dhdErrorGetLast(void) { return last_error; }

const char *dhdErrorGetStr(int error)
{
    return error == 5 ? "no device found" : error == 2 ? "communication error" : "error";
}

int dhdGetSystemType(char id) { (void)id; return system_type; }
const char *dhdGetSystemName(char id) { (void)id; return "stand-in omega"; }
bool dhdHasWrist(char id) { (void)id; return true; }
bool dhdHasActiveWrist(char id) { (void)id; return system_type == 104; }
bool dhdHasGripper(char id) { (void)id; return system_type == 104 || system_type == 108 || system_type == 109; }

int dhdGetGripperGap(double *gap, char id)
{
    (void)id;
    if (gone()) return fail(2);
    *gap = 0.010;
    return 0;
}

int dhdEnableForce(unsigned char value, char id)
{
    (void)id;
    if (gone()) return fail(2); /* DHD_ERROR_COM */
    forces_enabled = value;
    return 0;
}

int dhdSetWatchdog(unsigned char value, char id)
{
    (void)id;
    if (gone()) return fail(2);
    if (!has_watchdog) return fail(3); /* DHD_ERROR_DH_ERROR */
    watchdog = value;
    return 0;
}

/* Turned by a right angle about z: the rows are those of C. */
int dhdGetPositionAndOrientationFrame(double *x, double *y, double *z, double frame[3][3], char id)
{
    static const double turned[3][3] = {{0, -1, 0}, {1, 0, 0}, {0, 0, 1}};
    (void)id;
    if (calls == unplug_after) unplugged = 1;
    if (gone()) return fail(2);
    *x = position[0];
    *y = position[1];
    *z = position[2];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) frame[i][j] = turned[i][j];
    return ++calls % 3 == 0 ? 1 : 0; /* DHD_TIMEGUARD: early, and no error */
}

int dhdGetLinearVelocity(double *x, double *y, double *z, char id)
{
    (void)id;
    if (gone()) return fail(2);
    *x = velocity[0];
    *y = velocity[1];
    *z = velocity[2];
    return 0;
}

int dhdGetAngularVelocityRad(double *x, double *y, double *z, char id)
{
    (void)id;
    if (gone()) return fail(2);
    *x = 0.5;
    *y = *z = 0.0;
    return 0;
}

#ifndef WITHOUT_BUTTONS
unsigned dhdGetButtonMask(char id) { (void)id; return 5; }
#endif

int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty, double tz, double fg,
                                        char id)
{
    (void)id;
    if (gone()) return fail(2);
    gripper_force = fg;
    force[0] = fx;
    force[1] = fy;
    force[2] = fz;
    torque[0] = tx;
    torque[1] = ty;
    torque[2] = tz;
    for (int i = 0; i < 3; i++) {
        double felt = forces_enabled ? force[i] : 0.0;
        double f = felt + STIFFNESS * (hand[i] - position[i]) - DAMPING * velocity[i];
        velocity[i] += DT * f / MASS;
        position[i] += DT * velocity[i];
    }
    return fmax(fabs(fx), fmax(fabs(fy), fabs(fz))) > saturated_above ? 2 : 0; /* DHD_MOTOR_SATURATED: and no error */
}
