/* The loop: encoders, controller, torques, plant, 1000 times a second.
 *
 *     control_loop [--seconds S] [--log FILE] [--realtime] [--priority P]
 *
 * It ends with the status 1 where the arm did not follow, or the filter did not find it. */
#include "controller.h"
#include "plant.h"
#include "realtime.h"
#include "reference.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double seconds;
    const char *log; /* path, or NULL */
    int is_realtime;
    int priority;
} options;

typedef struct {
    long samples;
    double *rows;       /* NULL, or t, q and its estimate, torques: COLUMNS of each sample */
    long long *times;   /* NULL, or ns of all samples: how late, then of the controller, then of all */
    double tracking;    /* rad, the largest errors behind the time at which the arm has settled */
    double estimation;  /* rad */
    double velocity;    /* rad/s, of estimates */
    long missed;        /* times at which a sample was due, but the one before had not ended */
    long faults;        /* of pages, in the loop */
} record;

enum { COLUMNS = 1 + 2 * STATES + JOINTS, TIMES = 3 };

static controller law;
static plant arm;

/* Read the command line.  Returns whether it is understood. */
static int parse(int count, char **words, options *chosen)
{
    *chosen = (options){ .seconds = 2.0 * (move + rest), .priority = 80 };
    for (int i = 1; i < count; ++i) {
        const char *const value = (i + 1 < count) ? words[i + 1] : NULL;
        if (strcmp(words[i], "--realtime") == 0) {
            chosen->is_realtime = 1;
            continue;
        }
        if (value == NULL) { return 0; }
        if (strcmp(words[i], "--seconds") == 0) {
            chosen->seconds = strtod(value, NULL);
        } else if (strcmp(words[i], "--log") == 0) {
            chosen->log = value;
        } else if (strcmp(words[i], "--priority") == 0) {
            chosen->priority = atoi(value);
        } else {
            return 0;
        }
        ++i;
    }
    return (chosen->seconds > settled) && (chosen->seconds <= 3600.0) && (chosen->priority >= 0);
}

/* All memory of a run, written once, so that the loop finds its pages there. */
static void *memory(size_t size)
{
    void *const found = malloc(size);
    if (found == NULL) {
        fputs("out of memory\n", stderr);
        exit(1);
    }
    return memset(found, 1, size);
}

static double larger(double most, double error)
{
    return ((error > most) || isnan(error)) ? error : most;
}

/* Compare the plant with the reference and with the filter, after a sample. */
static void look(record *run, long sample)
{
    const ur5_model_observer *const found = &law.observer;
    double series[SERIES * JOINTS];
    reference(sample, series);
    for (int i = 0; (i < JOINTS) && (dt * (double)sample >= settled); ++i) {
        run->tracking = larger(run->tracking, fabs(arm.q[links[i]] - series[i]));
        run->estimation = larger(run->estimation, fabs(found->q[links[i]] - arm.q[links[i]]));
        run->velocity = larger(run->velocity, fabs(found->v[links[i]] - arm.v[links[i]]));
    }
    if (run->rows != NULL) {
        double *row = &run->rows[COLUMNS * (sample - 1)];
        *row++ = dt * (double)sample;
        (void)memcpy(row, arm.q, sizeof arm.q);
        (void)memcpy(&row[STATES], found->q, sizeof found->q);
        (void)memcpy(&row[2 * STATES], law.u, sizeof law.u);
    }
}

/* Run the loop.  Returns 0, or what failed. */
static const char *loop(record *run)
{
    double y[JOINTS], held[JOINTS];
    const long long period = llround(1e9 * dt);
    long long due = realtime_now() + 10 * period;
    const long faults = realtime_page_faults();
    for (long k = 0; k < run->samples; ++k) {
        if (run->times != NULL) { realtime_sleep_until(due); }
        const long long woken = realtime_now();
        plant_read(&arm, y);
        (void)memcpy(held, law.u, sizeof held); /* torque out, of the sample before */
        if (controller_step(&law, y) != 0) { return "the controller"; }
        const long long computed = realtime_now();
        if (plant_step(&arm, held) == 0) { return "the plant"; }
        look(run, k + 1);
        const long long end = realtime_now();
        if (run->times != NULL) {
            long long *const times = &run->times[k];
            times[0] = woken - due;
            times[run->samples] = computed - woken;
            times[2 * run->samples] = end - woken;
        }
        for (due += period; due < end; due += period) { ++run->missed; }
    }
    run->faults = realtime_page_faults() - faults;
    return NULL;
}

static int by_size(const void *one, const void *other)
{
    const long long a = *(const long long *)one, b = *(const long long *)other;
    return (a > b) - (a < b);
}

/* Print percentiles of the times, deadlines missed, and page faults. */
static void print_times(record *run)
{
    static const char *const names[TIMES] = { "wake-up late by", "controller", "controller and plant" };
    static const double shares[] = { 0.5, 0.99, 0.999, 1.0 };
    const long n = run->samples;
    printf("%-24s %9s %9s %9s %9s\n", "us", "median", "99 %", "99.9 %", "most");
    for (int kind = 0; kind < TIMES; ++kind) {
        long long *const times = &run->times[kind * n];
        qsort(times, (size_t)n, sizeof *times, by_size);
        printf("%-24s", names[kind]);
        for (int i = 0; i < 4; ++i) { printf(" %9.1f", 1e-3 * (double)times[lround(shares[i] * (double)(n - 1))]); }
        puts("");
    }
    printf("missed deadlines: %ld; page faults: %ld\n", run->missed, run->faults);
}

static int write_log(const record *run, const char *path)
{
    FILE *const file = fopen(path, "w");
    if (file == NULL) { return 0; }
    for (long i = 0; i < COLUMNS * run->samples; ++i) {
        fprintf(file, "%.17g%c", run->rows[i], ((i + 1) % COLUMNS != 0) ? ',' : '\n');
    }
    return fclose(file) == 0;
}

/* Print an error and its bound, in thousandths.  Returns whether it is within. */
static int judged(const char *what, double error, double allowed, const char *unit)
{
    printf("%s: %.4f %s at most, allowed %g\n", what, 1e3 * error, unit, 1e3 * allowed);
    return error <= allowed;
}

/* Print what a run found, and write its log.  Returns whether all is as it should be. */
static int reported(record *run, const options *chosen)
{
    if (run->times != NULL) { print_times(run); }
    int is_good = judged("tracking error of the links", run->tracking, allowed_tracking, "mrad");
    is_good = judged("error of their estimated angles", run->estimation, allowed_estimation, "mrad") && is_good;
    is_good = judged("error of their estimated velocities", run->velocity, allowed_velocity, "mrad/s") && is_good;
    if ((run->rows != NULL) && (write_log(run, chosen->log) == 0)) {
        printf("%s cannot be written\n", chosen->log);
        is_good = 0;
    }
    return is_good;
}

int main(int count, char **words)
{
    options chosen;
    record run = { 0 };
    double y[JOINTS];
    int is_good = 0;
    if (parse(count, words, &chosen) == 0) {
        fputs("usage: control_loop [--seconds S] [--log FILE] [--realtime] [--priority P]\n", stderr);
        return 2;
    }
    run.samples = lround(chosen.seconds / dt);
    if (chosen.is_realtime) { realtime_begin(chosen.priority); }
    if (chosen.log != NULL) { run.rows = memory(COLUMNS * (size_t)run.samples * sizeof *run.rows); }
    if (chosen.is_realtime) { run.times = memory(TIMES * (size_t)run.samples * sizeof *run.times); }

    plant_start(&arm);
    plant_read(&arm, y);
    const char *const failed = (controller_start(&law, y) != 0) ? "the beginning" : loop(&run);
    if (failed != NULL) {
        printf("%s failed at sample %ld\n", failed, law.sample);
    } else {
        is_good = reported(&run, &chosen);
    }
    free(run.rows);
    free(run.times);
    return is_good ? 0 : 1;
}
