/* The hardware layer on the port of musselbed: docs/firmware-port.md has its frames and the devices on its I2C bus. */
#include "hal.h"

#include "../musselbed.h"

#include <string.h>

#define MOST_TASKS 8
#define LARGEST_PACKET 512

enum address { RAILS = 0x20, MONITOR = 0x36, SENSOR = 0x40, PLACE = 0x48, SETTINGS = 0x50, MOTORS = 0x60, CLOCK = 0x68 };
enum clock_register { TIME = 0, ALARM = 8, SAMPLES = 16, ACKNOWLEDGED = 20, AGE = 24 };

static uint64_t ticks, due[MOST_TASKS];
static enum hal_sleep asleep, told;

static uint64_t get(const uint8_t *at, unsigned bytes) {
    uint64_t value = 0;
    while (bytes--)
        value = value << 8 | at[bytes];
    return value;
}

static void put(uint8_t *at, uint64_t value, unsigned bytes) {
    for (; bytes--; value >>= 8)
        *at++ = (uint8_t)value;
}

/* The counter wraps; a check of the pin each minute sees every wrap. */
static void follow_counter(void) { ticks += (uint32_t)(mu_now() - (uint32_t)ticks); }

uint64_t hal_now(void) { return (ticks * 1000 + MU_HZ - 1) / MU_HZ; }

void hal_timer(size_t task, uint64_t at) { due[task] = at; }

static size_t next_task(size_t count) {
    size_t first = 0;
    for (size_t n = 1; n < count; n++)
        if (due[n] < due[first])
            first = n;
    return first;
}

static void set_alarm(size_t count) {
    uint64_t at = due[next_task(count)];
    if (at == HAL_NEVER)
        mu_alarm_off();
    else
        mu_alarm((uint32_t)(at * MU_HZ / 1000));
}

static void ring(const struct hal_task *tasks, size_t count) {
    for (size_t n = next_task(count); due[n] <= hal_now(); n = next_task(count)) {
        due[n] = HAL_NEVER;
        tasks[n].timer();
    }
}

const struct mu_config *hal_config(void) { return mu_config(); }

static enum hal_event_kind kind_of(const struct mu_event *event) {
    static const enum hal_event_kind LINES[] = {
        [MU_CHARGER] = HAL_CHARGER,     [MU_SURFACE] = HAL_SURFACE,
        [MU_BOTTOM] = HAL_BOTTOM,       [MU_BATTERY_EMPTY] = HAL_EMPTIED,
        [MU_CLOCK] = HAL_CLOCK,         [MU_SAFE_LEVEL] = HAL_SAFE_LEVEL,
        [MU_ON_SECONDARY] = HAL_OTHER,  [MU_LOW_LEVEL] = HAL_LOW_LEVEL,
        [MU_SWITCH_BACK] = HAL_OTHER,   [MU_REPORT] = HAL_REPORT};
    if (event->kind == MU_RESET)
        return HAL_RESET;
    if (event->kind == MU_UART)
        return HAL_PACKET;
    return event->port < sizeof LINES / sizeof *LINES ? LINES[event->port] : HAL_OTHER;
}

void hal_run(const struct hal_task *tasks, size_t count) {
    static uint8_t packet[LARGEST_PACKET];
    struct mu_event event;
    if (count > MOST_TASKS || !mu_open("whole"))
        return;
    for (size_t n = 0; n < count; n++)
        due[n] = HAL_NEVER;
    while (mu_wait(&event)) {
        follow_counter();
        if (event.kind == MU_ALARM) {
            ring(tasks, count);
        } else {
            struct hal_event happened = {kind_of(&event), event.port, packet, event.size};
            if (event.size > sizeof packet)
                happened.size = 0; /* no command is so long */
            else if (event.size)
                memcpy(packet, event.data, event.size);
            for (size_t n = 0; n < count; n++)
                tasks[n].event(&happened);
        }
        set_alarm(count);
        told = asleep;
    }
}

bool hal_charger(void) { return mu_level(MU_CHARGER); }

bool hal_at_surface(void) { return mu_level(MU_SURFACE); }

bool hal_at_safe_level(void) { return mu_level(MU_SAFE_LEVEL); }

enum hal_feed hal_feed(void) { return mu_level(MU_ON_SECONDARY) ? HAL_SECONDARY : HAL_PRIMARY; }

void hal_rails(uint16_t wanted, enum hal_sleep sleep) {
    uint8_t bytes[2];
    put(bytes, wanted, sizeof bytes);
    mu_i2c(RAILS, bytes, sizeof bytes, NULL, 0);
    asleep = sleep;
    mu_sleep_mode((enum mu_sleep)sleep);
}

uint16_t hal_powered(void) {
    uint8_t bytes[2] = {0, 0};
    mu_i2c(RAILS, NULL, 0, bytes, sizeof bytes);
    uint16_t powered = (uint16_t)get(bytes, sizeof bytes);
    if (asleep != told) { /* the core's own rail changes at the end of this turn */
        powered = (uint16_t)(powered & ~(1u << HAL_MU_ASLEEP | 1u << HAL_MU_ACTIVE));
        powered = (uint16_t)(powered | 1u << (asleep == HAL_AWAKE ? HAL_MU_ACTIVE : HAL_MU_ASLEEP));
    }
    return powered;
}

void hal_stay_awake(uint64_t ms) { mu_busy((uint32_t)ms); }

void hal_motors(enum hal_way way, uint32_t depth_mm) {
    uint8_t bytes[4];
    put(bytes, depth_mm, sizeof bytes);
    if (way == HAL_HOVER) {
        mu_i2c(MOTORS, bytes, sizeof bytes, NULL, 0);
        return;
    }
    enum mu_output line = way == HAL_FLOAT ? MU_MOTOR_UP : MU_MOTOR_DOWN;
    mu_pin(line, true);
    mu_pin(line, false); /* the driver ends a run by itself */
}

void hal_send_sound(const void *data, size_t size) { mu_send(MU_MODEM, data, size); }

void hal_send_wifi(const void *data, size_t size) { mu_send(MU_WIFI, data, size); }

void hal_send_report(const void *data, size_t size) { mu_send(MU_REPORT_LINE, data, size); }

static uint64_t read_clock(enum clock_register at, uint8_t bytes) {
    uint8_t from = (uint8_t)at, value[8] = {0};
    mu_i2c(CLOCK, &from, 1, value, bytes);
    return get(value, bytes);
}

static void write_clock(enum clock_register at, uint64_t value, unsigned bytes) {
    uint8_t message[9] = {(uint8_t)at};
    put(message + 1, value, bytes);
    mu_i2c(CLOCK, message, 1 + bytes, NULL, 0);
}

uint64_t hal_clock(void) { return read_clock(TIME, 8); }

void hal_set_clock(uint64_t reading) { write_clock(TIME, reading, 8); }

uint64_t hal_clock_age(void) { return read_clock(AGE, 8); }

void hal_clock_alarm(uint64_t reading) { write_clock(ALARM, reading, 8); }

uint32_t hal_load(enum hal_register at) { return (uint32_t)read_clock(at == HAL_SAMPLES ? SAMPLES : ACKNOWLEDGED, 4); }

void hal_store(enum hal_register at, uint32_t value) { write_clock(at == HAL_SAMPLES ? SAMPLES : ACKNOWLEDGED, value, 4); }

struct hal_settings hal_load_settings(void) {
    uint8_t bytes[26] = {0};
    mu_i2c(SETTINGS, NULL, 0, bytes, sizeof bytes);
    return (struct hal_settings){(uint32_t)get(bytes, 4),      (uint32_t)get(bytes + 4, 4),  (uint32_t)get(bytes + 8, 4),
                                 (uint32_t)get(bytes + 12, 4), (uint32_t)get(bytes + 16, 4), (uint16_t)get(bytes + 20, 2),
                                 (int32_t)get(bytes + 22, 4)};
}

void hal_store_settings(const struct hal_settings *settings) {
    uint8_t bytes[26];
    put(bytes, settings->alarm_ms, 4);
    put(bytes + 4, settings->sample_ms, 4);
    put(bytes + 8, settings->frame_ms, 4);
    put(bytes + 12, settings->slot_ms, 4);
    put(bytes + 16, settings->guard_ms, 4);
    put(bytes + 20, settings->slot, 2);
    put(bytes + 22, (uint32_t)settings->offset_ms, 4);
    mu_i2c(SETTINGS, bytes, sizeof bytes, NULL, 0);
}

void hal_set_level(uint8_t which, uint16_t value) {
    uint8_t bytes[3] = {which};
    put(bytes + 1, value, 2);
    mu_i2c(MONITOR, bytes, sizeof bytes, NULL, 0);
}

bool hal_flash_read(uint32_t at, void *data, uint16_t size) { return mu_flash_read(at, data, size); }

bool hal_flash_program(uint32_t at, const void *data, uint16_t size) { return mu_flash_program(at, data, size); }

bool hal_flash_erase(uint16_t page) { return mu_flash_erase(page); }

/* In 1/255, rounded, from the monitor's 32 bits. */
static uint8_t shortened(const uint8_t *bytes) { return (uint8_t)((get(bytes, 4) * 255 + UINT32_MAX / 2) / UINT32_MAX); }

struct hal_charges hal_charges(void) {
    uint8_t bytes[8] = {0};
    mu_i2c(MONITOR, NULL, 0, bytes, sizeof bytes);
    return (struct hal_charges){mu_adc(MU_PRIMARY), mu_adc(MU_SECONDARY), shortened(bytes), shortened(bytes + 4)};
}

struct hal_place hal_place(void) {
    uint8_t bytes[10] = {0};
    mu_i2c(PLACE, NULL, 0, bytes, sizeof bytes);
    return (struct hal_place){(int32_t)get(bytes, 4), (int32_t)get(bytes + 4, 4), (uint16_t)get(bytes + 8, 2)};
}

bool hal_sensor(unsigned sensor, uint16_t *counts, bool *saturated) {
    uint8_t bytes[3];
    if (!mu_i2c((uint8_t)(SENSOR + sensor), NULL, 0, bytes, sizeof bytes))
        return false;
    *counts = (uint16_t)get(bytes, 2);
    *saturated = bytes[2];
    return true;
}

uint16_t hal_crc(const uint8_t *data, size_t size) { return mu_crc(data, size); }

void hal_tell_state(uint8_t state) { mu_state(state); }

void hal_refuse(const char *text) { mu_refuse(text); }

void hal_fault(const char *text) { mu_log(text); }
