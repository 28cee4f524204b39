/* A stand-in for OpenHaptics' HDAPI: the functions that the driver calls, with a servo thread of its own and a device in
 * arithmetic only.
 *
 * The device is a mass on a spring to a hand, in millimetres as the library's; each frame moves it by a millisecond. Calls
 * that belong into a frame and are made outside are errors. Functions that begin with stand_in_ are the test's; where the
 * library is loaded by another program, the environment says where the hand goes (STAND_IN_HAND, "x y z" in m), after how many
 * frames with a force the plug is pulled (STAND_IN_UNPLUG), the servo thread calls no more (STAND_IN_STALL; 0: it never calls)
 * or poses are no numbers (STAND_IN_NAN), that there is no device (STAND_IN_ABSENT), and the file that is told at the end
 * whether forces are enabled, which the motors were asked for last, and which was the largest (STAND_IN_LAST_WORD).
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <pthread.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef struct {
    unsigned code;
    int internal;
    unsigned device;
} HDErrorInfo;

typedef unsigned (*callback)(void *);

enum {
    INVALID_OPERATION = 0x0102,
    ILLEGAL_BEGIN = 0x0400,
    COMM_ERROR = 0x0302,
    FORCE_OUTPUT = 0x4000,
    CURRENT_BUTTONS = 0x2000,
    CURRENT_VELOCITY = 0x2051,
    CURRENT_TRANSFORM = 0x2052,
    CURRENT_ANGULAR_VELOCITY = 0x2053,
    NOMINAL_MAX_FORCE = 0x2603,
    CURRENT_FORCE = 0x2700
};

static const double MASS = 0.1, DAMPING = 6.0, STIFFNESS = 350.0, DT = 1e-3;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_t servo;
static int running = 0, stopped = 0, stalled = 0, unplugged = 0, absent = 0, in_frame = 0, initialised = 0;
static int force_output = 0;
static unsigned error_code = 0;
static callback scheduled = NULL;
static void *scheduled_data = NULL;
static double position[3], velocity[3], hand[3], force[3]; /* m, m/s, m, N */
static long frames = 0;
static long frames_with_force = 0, unplug_after = -1, stall_after = -1, nan_after = -1;
static double largest_force = 0.0;

static void raise_error(unsigned code)
{
    if (error_code == 0) error_code = code;
}

void stand_in_absent(int on) { absent = on; }
void stand_in_unplug(int on) { pthread_mutex_lock(&lock); unplugged = on; pthread_mutex_unlock(&lock); }
void stand_in_stall(int on) { pthread_mutex_lock(&lock); stalled = on; pthread_mutex_unlock(&lock); }
int stand_in_open(void) { return initialised; }
int stand_in_enabled(void) { return force_output; }
long stand_in_frames(void)
{
    pthread_mutex_lock(&lock);
    long n = frames;
    pthread_mutex_unlock(&lock);
    return n;
}
void stand_in_hand(double x, double y, double z)
{
    pthread_mutex_lock(&lock);
    hand[0] = x;
    hand[1] = y;
    hand[2] = z;
    pthread_mutex_unlock(&lock);
}
void stand_in_force(double *out)
{
    pthread_mutex_lock(&lock);
    for (int i = 0; i < 3; i++) out[i] = force[i];
    pthread_mutex_unlock(&lock);
}

static long number_of(const char *variable)
{
    const char *text = getenv(variable);
    return text != NULL ? atol(text) : -1;
}

unsigned hdInitDevice(const char *name)
{
    const char *text = getenv("STAND_IN_HAND");
    (void)name;
    if (text != NULL) sscanf(text, "%lf %lf %lf", &hand[0], &hand[1], &hand[2]);
    unplug_after = number_of("STAND_IN_UNPLUG");
    stall_after = number_of("STAND_IN_STALL");
    nan_after = number_of("STAND_IN_NAN");
    if (absent || getenv("STAND_IN_ABSENT") != NULL) {
        raise_error(0x0300); /* HD_DEVICE_FAULT */
        return 0xFFFFFFFFu;
    }
    initialised = 1;
    return 7;
}

void hdDisableDevice(unsigned device)
{
    const char *path = getenv("STAND_IN_LAST_WORD");
    FILE *file = path != NULL ? fopen(path, "w") : NULL;
    if (device != 7) raise_error(0x0104);
    initialised = 0;
    if (file != NULL) {
        fprintf(file, "%d %.17g %.17g %.17g %.17g\n", force_output, force[0], force[1], force[2], largest_force);
        fclose(file);
    }
}

void hdMakeCurrentDevice(unsigned device)
{
    if (device != 7) raise_error(0x0104); /* HD_BAD_HANDLE */
}

void hdBeginFrame(unsigned device)
{
    if (device != 7 || in_frame) raise_error(ILLEGAL_BEGIN);
    in_frame = 1;
}

void hdEndFrame(unsigned device)
{
    if (device != 7 || !in_frame) raise_error(ILLEGAL_BEGIN);
    in_frame = 0;
    if (frames_with_force == unplug_after) unplugged = 1;
    if (unplugged) raise_error(COMM_ERROR);
    frames++;
    if (force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0) frames_with_force++;
    largest_force = fmax(largest_force, sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]));
    for (int i = 0; i < 3; i++) {
        double felt = force_output ? force[i] : 0.0;
        double f = felt + STIFFNESS * (hand[i] - position[i]) - DAMPING * velocity[i];
        velocity[i] += DT * f / MASS;
        position[i] += DT * velocity[i];
    }
}

HDErrorInfo hdGetError(void)
{
    HDErrorInfo info = {error_code, 0, 7};
    error_code = 0;
    return info;
}

const char *hdGetErrorString(unsigned code) { return code == 0x0300 ? "device fault" : "error"; }

void hdEnable(unsigned capability)
{
    if (capability == FORCE_OUTPUT) force_output = 1;
}

void hdDisable(unsigned capability)
{
    if (capability == FORCE_OUTPUT) force_output = 0;
}

void hdGetIntegerv(unsigned name, int *out)
{
    if (!in_frame || name != CURRENT_BUTTONS) {
        raise_error(INVALID_OPERATION);
        return;
    }
    *out = 3;
}

void hdGetDoublev(unsigned name, double *out)
{
    if (name == NOMINAL_MAX_FORCE) {
        *out = 3.3;
        return;
    }
    if (!in_frame) {
        raise_error(INVALID_OPERATION);
        return;
    }
    switch (name) {
    case CURRENT_TRANSFORM: { /* by columns, turned by a right angle about z, in millimetres */
        const double m[16] = {0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
        for (int i = 0; i < 16; i++) out[i] = m[i];
        for (int i = 0; i < 3; i++) out[12 + i] = position[i] * 1e3;
        if (nan_after >= 0 && frames_with_force >= nan_after) out[13] = NAN;
        break;
    }
    case CURRENT_VELOCITY:
        for (int i = 0; i < 3; i++) out[i] = velocity[i] * 1e3;
        break;
    case CURRENT_ANGULAR_VELOCITY:
        out[0] = 0.5;
        out[1] = out[2] = 0.0;
        break;
    default:
        raise_error(0x0100); /* HD_INVALID_ENUM */
    }
}

const char *hdGetString(unsigned name)
{
    return name == 0x2501 ? "stand-in Touch" : NULL;
}

void hdSetDoublev(unsigned name, const double *in)
{
    if (!in_frame || name != CURRENT_FORCE) {
        raise_error(INVALID_OPERATION);
        return;
    }
    for (int i = 0; i < 3; i++) force[i] = in[i];
}

static void *serve(void *unused)
{
    struct timespec period = {0, 1000000};
    (void)unused;
    for (;;) {
        pthread_mutex_lock(&lock);
        if (stopped) {
            pthread_mutex_unlock(&lock);
            return NULL;
        }
        int stuck = stalled || (stall_after >= 0 && frames_with_force >= stall_after);
        if (!stuck && scheduled != NULL && scheduled(scheduled_data) == 0) scheduled = NULL;
        pthread_mutex_unlock(&lock);
        nanosleep(&period, NULL);
    }
}

void hdStartScheduler(void)
{
    if (running) return;
    stopped = 0;
    running = pthread_create(&servo, NULL, serve, NULL) == 0;
}

void hdStopScheduler(void)
{
    if (!running) return;
    pthread_mutex_lock(&lock);
    stopped = 1;
    pthread_mutex_unlock(&lock);
    pthread_join(servo, NULL);
    running = 0;
}

unsigned long hdScheduleAsynchronous(callback call, void *data, unsigned short priority)
{
    (void)priority;
    pthread_mutex_lock(&lock);
    scheduled = call;
    scheduled_data = data;
    pthread_mutex_unlock(&lock);
    return 1;
}

#ifndef WITHOUT_UNSCHEDULE
void hdUnschedule(unsigned long handle)
{
    (void)handle;
    pthread_mutex_lock(&lock);
    scheduled = NULL;
    pthread_mutex_unlock(&lock);
}
#endif
