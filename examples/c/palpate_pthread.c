/* A haptic driver in C: a thread that ticks at 1 kHz, and a device that exists in arithmetic only.
 *
 * The device is a mass held by a hand (spring and damper to a path); it comes down on the middle of the body from above
 * until the tool touches, is pressed in, held there and taken away. A driver of hardware replaces read_device and write_device by the vendor's calls.
 *
 *   palpate_pthread [scene [seconds]]      "block" is a scene that the library carries
 *
 * Meanwhile the main thread does what a screen does: thirty times a second it copies where the nodes of the body are.
 *
 * Prints the force at each depth, the largest one, what the simulation was like, and how deep the skin was dented.
 */
#define _POSIX_C_SOURCE 200809L

#include "palpate.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PERIOD_NS 1000000 /* 1 kHz */
#define SUBSTEPS 10       /* of the device's own motion */
#define MOST_SAMPLES 60000
#define PI 3.14159265358979323846

/* The hand: published values of an arm that holds a stylus. The device: a light one with a little friction. */
static const double HAND_MASS = 0.05, HAND_DAMPING = 4.0, HAND_STIFFNESS = 350.0;
static const double DEVICE_MASS = 0.1, DEVICE_DAMPING = 0.2;

/* How far above the body the tool's origin begins, and how far below the touch the hand then wants to be (m). */
static const double CLEARANCE = 0.06;
static const double PRESS = 0.006;
static const double LIFT = 0.014; /* above that, at the end */

typedef struct {
    double position[3], velocity[3]; /* m, m/s */
    double force[3];                 /* of the motors, held from tick to tick (N) */
} device;

typedef struct {
    double height, force, opposing; /* of the ball (m), norm and part along +z of the force on the hand (N) */
    uint32_t contacts, flags;
} sample;

typedef struct {
    palpate_port *port;
    device device;
    double seconds;
    double start[3], bottom; /* where the hand begins, and how low it looks for the body (m) */
    double touched_at, skin; /* time (s) and height (m) of the first touch; -1: none yet */
    long ticks, late, errors;
    double largest_force, largest_work;
    uint32_t flags_seen;
    volatile int done;
    sample *samples;
} driver;

/* From 0 to 1 without a jerk. */
static double smooth(double share)
{
    if (share < 0.0) share = 0.0;
    if (share > 1.0) share = 1.0;
    return 0.5 * (1.0 - cos(PI * share));
}

/* Where the hand wants the device at time t: evenly down, in half of the run at most, until the tool touches. Of what is left
 * from there, a quarter to press, a half to hold, a quarter to go up. */
static double wanted_height(const driver *me, double t)
{
    if (me->touched_at < 0.0) {
        double share = t / (0.5 * me->seconds);
        return me->start[2] - (me->start[2] - me->bottom) * (share < 1.0 ? share : 1.0);
    }
    double share = (t - me->touched_at) / (me->seconds - me->touched_at);
    return me->skin - PRESS * smooth(4.0 * share) + LIFT * smooth(4.0 * share - 3.0);
}

/* The device moves for dt under its motors' force and the hand's. Semi-implicit Euler: stable for these numbers. */
static void move_device(driver *me, double t, double dt)
{
    const double mass = DEVICE_MASS + HAND_MASS;
    device *d = &me->device;
    for (int k = 0; k < SUBSTEPS; k++) {
        double h = dt / SUBSTEPS;
        double wanted[3] = {me->start[0], me->start[1], wanted_height(me, t + k * h)};
        for (int i = 0; i < 3; i++) {
            double f = d->force[i] + HAND_STIFFNESS * (wanted[i] - d->position[i]) -
                       (HAND_DAMPING + DEVICE_DAMPING) * d->velocity[i];
            d->velocity[i] += h * f / mass;
            d->position[i] += h * d->velocity[i];
        }
    }
}

static void read_device(const device *d, palpate_input *in)
{
    for (int i = 0; i < 3; i++) {
        in->position[i] = d->position[i];
        in->velocity[i] = d->velocity[i];
    }
    in->orientation[0] = 1.0;
    in->fields = PALPATE_INPUT_VELOCITY;
}

static void write_device(device *d, const palpate_output *out)
{
    for (int i = 0; i < 3; i++) d->force[i] = out->force[i];
}

static uint64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static void sleep_until(uint64_t ns)
{
    struct timespec t;
    t.tv_sec = (time_t)(ns / 1000000000u);
    t.tv_nsec = (long)(ns % 1000000000u);
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) != 0) {
    }
}

/* The driver's thread. It keeps its beat; a beat that it misses is left out. */
static void *drive(void *argument)
{
    driver *me = argument;
    palpate_input in;
    palpate_output out;
    memset(&in, 0, sizeof in);
    memset(&out, 0, sizeof out);
    in.struct_size = sizeof in;
    out.struct_size = sizeof out;
    if (palpate_raise_priority() != PALPATE_STATUS_OK) fprintf(stderr, "driver: %s\n", palpate_last_error());

    uint64_t start = now_ns(), next = start, before = start;
    uint64_t end = start + (uint64_t)(me->seconds * 1e9);
    while (next < end) {
        sleep_until(next);
        uint64_t now = now_ns();
        double t = (double)(before - start) * 1e-9;
        move_device(me, t, (double)(now - before) * 1e-9);
        before = now;

        read_device(&me->device, &in);
        in.time_ns = now;
        palpate_status status = palpate_tick(me->port, &in, &out);
        write_device(&me->device, &out); /* zero after an error */

        if (status < 0) me->errors++;
        if (me->touched_at < 0.0 && out.contacts > 0) {
            me->touched_at = t;
            me->skin = me->device.position[2];
        }
        me->flags_seen |= out.flags;
        if (out.work > me->largest_work) me->largest_work = out.work;
        double norm = sqrt(out.force[0] * out.force[0] + out.force[1] * out.force[1] + out.force[2] * out.force[2]);
        if (norm > me->largest_force) me->largest_force = norm;
        if (me->ticks < MOST_SAMPLES) {
            sample s = {me->device.position[2], norm, out.force[2], out.contacts, out.flags};
            me->samples[me->ticks] = s;
        }
        me->ticks++;
        for (next += PERIOD_NS; next <= now; next += PERIOD_NS) me->late++;
    }
    me->done = 1;
    return NULL;
}

static int check(palpate_status status, const char *what)
{
    if (status >= 0) return 0;
    fprintf(stderr, "%s: %s: %s\n", what, palpate_status_text(status), palpate_last_error());
    return 1;
}

/* The force by depth while the hand presses, in eight bins of a millimetre. */
static void print_depths(const driver *d)
{
    double force[8] = {0}, opposing[8] = {0};
    long count[8] = {0}, free_ticks = 0;
    double largest_free = 0.0;
    long n = d->ticks < MOST_SAMPLES ? d->ticks : MOST_SAMPLES;
    for (long k = 0; k < n; k++) {
        const sample *s = &d->samples[k];
        double depth = d->skin - s->height;
        int bin = (int)floor(depth * 1e3);
        if (depth < -0.001 && s->contacts == 0) {
            free_ticks++;
            if (s->force > largest_free) largest_free = s->force;
        }
        if (bin < 0 || bin > 7 || (s->flags & PALPATE_TICK_FADE_IN)) continue;
        force[bin] += s->force;
        opposing[bin] += s->opposing;
        count[bin]++;
    }
    printf("free: %ld ticks, largest force %.6f N\n", free_ticks, largest_free);
    for (int bin = 0; bin < 8; bin++) {
        if (count[bin] == 0) continue;
        printf("depth %d to %d mm: force %.4f N, upwards %.4f N, %ld ticks\n", bin, bin + 1,
               force[bin] / (double)count[bin], opposing[bin] / (double)count[bin], count[bin]);
    }
}

/* What a screen would draw: the triangles once and after each cut, the nodes in each picture. */
typedef struct {
    palpate_surface surface;
    double *positions; /* x, y, z of each node (m) */
    uint32_t *triangles;
    double dent; /* most that a node of the skin has gone down (m) */
    long pictures;
} screen;

/* Copies the triangles that belong to the surface as it is known now: cut tissue has others. */
static int copy_triangles(const palpate_simulation *simulation, screen *s)
{
    free(s->triangles);
    s->triangles = calloc(3 * s->surface.triangles, sizeof *s->triangles);
    if (s->triangles == NULL) return 1;
    return check(palpate_surface_triangles(simulation, s->surface.events, s->triangles, s->surface.triangles), "triangles");
}

static int open_screen(const palpate_simulation *simulation, screen *s)
{
    s->surface.struct_size = sizeof s->surface;
    if (check(palpate_surface_counts(simulation, &s->surface), "surface")) return 1;
    s->positions = calloc(3 * s->surface.nodes, sizeof *s->positions);
    return s->positions == NULL ? 1 : copy_triangles(simulation, s);
}

/* Puts the device above the middle of the body. Its frame is the world's. */
static int place_device(const palpate_simulation *simulation, screen *s, driver *d)
{
    if (check(palpate_surface_positions(simulation, s->positions, s->surface.nodes, &s->surface), "positions")) return 1;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t k = 0; k < 3 * (size_t)s->surface.nodes; k++) {
        low[k % 3] = fmin(low[k % 3], s->positions[k]);
        high[k % 3] = fmax(high[k % 3], s->positions[k]);
    }
    d->start[0] = 0.5 * (low[0] + high[0]);
    d->start[1] = 0.5 * (low[1] + high[1]);
    d->start[2] = high[2] + CLEARANCE;
    d->bottom = low[2];
    memcpy(d->device.position, d->start, sizeof d->start);
    return 0;
}

/* Draws until the driver's thread has ended. */
static void draw(const palpate_simulation *simulation, screen *s, const volatile int *done)
{
    size_t numbers = 3 * s->surface.nodes;
    double *rest = malloc(numbers * sizeof *rest);
    if (rest == NULL) return;
    while (!*done) {
        uint32_t events = s->surface.events;
        if (check(palpate_surface_positions(simulation, s->positions, s->surface.nodes, &s->surface), "positions")) break;
        if (s->surface.events != events && copy_triangles(simulation, s)) break;
        if (s->pictures++ == 0) memcpy(rest, s->positions, numbers * sizeof *rest);
        for (size_t k = 0; k < 3 * s->surface.triangles; k++) {
            size_t z = 3 * (size_t)s->triangles[k] + 2;
            if (rest[z] - s->positions[z] > s->dent) s->dent = rest[z] - s->positions[z];
        }
        sleep_until(now_ns() + 33000000);
    }
    free(rest);
}

static void print_statistics(const palpate_statistics_data *s)
{
    static const char *const phases[] = {"ready", "running", "paused", "stopped", "failed"};
    printf("phase %s: %llu steps (%.1f Hz), %llu ticks (%.0f Hz), %llu missed by the driver, %llu refused\n",
           s->phase < 5 ? phases[s->phase] : "unknown", (unsigned long long)s->steps, s->step_rate,
           (unsigned long long)s->ticks, s->tick_rate, (unsigned long long)s->tick_overruns,
           (unsigned long long)s->refused);
    printf("tick: median %.1f us, 99 %% %.1f us, largest %.1f us; step: median %.2f ms\n", s->tick_work[0] * 1e6,
           s->tick_work[1] * 1e6, s->tick_work[2] * 1e6, s->step_work[0] * 1e3);
}

int main(int argc, char **argv)
{
    const char *scene = argc > 1 ? argv[1] : "block";
    driver driver;
    memset(&driver, 0, sizeof driver);
    driver.seconds = argc > 2 ? atof(argv[2]) : 4.0;
    driver.touched_at = driver.skin = -1.0;
    if (!(driver.seconds > 0.0)) {
        fprintf(stderr, "usage: %s [scene [seconds]]\n", argv[0]);
        return 2;
    }

    palpate_options options;
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.threads = 1;
    options.rate = 1e9 / PERIOD_NS;
    options.max_force = 6.0;
    options.device_mass = DEVICE_MASS; /* with the damping: the coupling is as stiff as this device bears */
    options.device_damping = DEVICE_DAMPING;
    for (int i = 0; i < 3; i++) options.axes[i] = i + 1; /* the device's frame is the world's, whatever the scene says */

    palpate_simulation *simulation = NULL;
    screen screen;
    memset(&screen, 0, sizeof screen);
    pthread_t thread;
    int failed = 1;
    printf("palpate %s, scene %s\n", palpate_version(), scene);
    driver.samples = calloc(MOST_SAMPLES, sizeof *driver.samples);
    if (driver.samples == NULL) return 1;
    if (check(palpate_create_from_file(scene, &options, &simulation), "create") == 0 &&
        check(palpate_open_port(simulation, &driver.port), "open") == 0 &&
        open_screen(simulation, &screen) == 0 && place_device(simulation, &screen, &driver) == 0 &&
        check(palpate_start(simulation), "start") == 0) {
        if (pthread_create(&thread, NULL, drive, &driver) == 0) {
            draw(simulation, &screen, &driver.done);
            pthread_join(thread, NULL);
            palpate_statistics_data statistics;
            memset(&statistics, 0, sizeof statistics);
            statistics.struct_size = sizeof statistics;
            failed = check(palpate_statistics(simulation, &statistics), "statistics");
            if (driver.touched_at < 0.0) {
                fprintf(stderr, "the tool came down through the middle of the body and touched nothing\n");
                failed = 1;
            }
            print_depths(&driver);
            print_statistics(&statistics);
            printf("screen: %ld pictures of %llu nodes and %llu triangles, dent %.2f mm\n", screen.pictures,
                   (unsigned long long)screen.surface.nodes, (unsigned long long)screen.surface.triangles,
                   screen.dent * 1e3);
            printf("largest force %.4f N, largest work %.1f us, %ld late, %ld errors\n", driver.largest_force,
                   driver.largest_work * 1e6, driver.late, driver.errors);
        }
        failed |= check(palpate_stop(simulation), "stop");
    }
    palpate_close_port(driver.port);
    palpate_destroy(simulation);
    free(driver.samples);
    free(screen.positions);
    free(screen.triangles);
    return failed || driver.errors > 0 ? 1 : 0;
}
