/* The clock chip's time: alarms at whole multiples of a period, timeslots, and the setting by a beacon. */
#include "board.h"

#define BILLION 1000000000u

struct hal_settings settings;
static uint64_t passed;   /* alarms up to this reading have rung, or are skipped */
static int64_t corrected; /* the clock minus the last beacon's time */

void clock_start(void) {
    settings = hal_load_settings();
    passed = hal_clock();
    corrected = 0;
}

/* A clock set back by more than a period begins a new count; a small correction rings no alarm twice. */
static bool was_set_back(uint64_t reading) { return passed > reading + settings.alarm_ms; }

void clock_pass_over(void) {
    uint64_t reading = hal_clock();
    if (reading > passed || was_set_back(reading))
        passed = reading;
}

uint64_t clock_next_alarm(void) { return (passed / settings.alarm_ms + 1) * settings.alarm_ms; }

void clock_rang(void) { passed = clock_next_alarm(); }

void clock_set(uint64_t reading) {
    corrected = (int64_t)(hal_clock() - reading);
    hal_set_clock(reading);
    if (was_set_back(reading))
        passed = reading;
}

int32_t clock_offset(void) {
    return corrected > INT32_MAX ? INT32_MAX : corrected < INT32_MIN ? INT32_MIN : (int32_t)corrected;
}

uint64_t clock_slot(bool *doubted) {
    const struct mu_config *config = hal_config();
    int64_t first = (int64_t)settings.slot * settings.slot_ms + settings.guard_ms + settings.offset_ms;
    int64_t reading = (int64_t)hal_clock(), frame = settings.frame_ms;
    int64_t frames = (reading - first) / frame + (reading > first && (reading - first) % frame ? 1 : 0);
    int64_t at = first + frames * frame;
    uint64_t elapsed = hal_clock_age() + (uint64_t)(at - reading);
    uint64_t doubt = (elapsed * config->drift_bound_ppb + BILLION - 1) / BILLION;
    *doubted = config->doubts_clock && doubt > settings.guard_ms;
    return (uint64_t)at;
}

void settings_changed(void) {
    clock_pass_over(); /* the alarms of the new period begin now */
    hal_store_settings(&settings);
}
