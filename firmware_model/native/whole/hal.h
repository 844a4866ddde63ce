/* The hardware layer of the whole board: all that its tasks know of the world. hal_musselbed.c has it for the port of
 * musselbed; a port to a kernel or a microcontroller replaces that file and nothing else.
 *
 * Times are in milliseconds of the board's own timer, which does not stop in sleep, and never go back. */
#ifndef HAL_H
#define HAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../board_config.h"

#define HAL_NEVER UINT64_MAX
#define HAL_HERE UINT32_MAX /* the present depth */
#define HAL_SENSORS 4
#define HAL_PAGES 16u
#define HAL_PAGE_BYTES 4096u

enum hal_event_kind {
    HAL_RESET,
    HAL_CHARGER, /* the pin's level changed, or a part of it */
    HAL_SURFACE,
    HAL_BOTTOM,
    HAL_CLOCK, /* the clock chip's alarm */
    HAL_EMPTIED,
    HAL_SAFE_LEVEL,
    HAL_LOW_LEVEL,
    HAL_PACKET, /* by sound or by Wi-Fi */
    HAL_REPORT, /* the experiment asks for a status */
    HAL_OTHER
};

struct hal_event {
    enum hal_event_kind kind;
    uint8_t cause; /* of a reset */
    const uint8_t *data; /* of a packet, until the event is over */
    size_t size;
};

/* A task runs to its end, and never waits. `event` gets every event, `timer` is called once when the task's timer is due.
 * Tasks share the board's state: where each has a thread of its own, one lock goes around every call. */
struct hal_task {
    void (*event)(const struct hal_event *event);
    void (*timer)(void);
};

/* Runs the tasks until the power ends: an event goes to each of them in order, and of timers due at once the first first. */
void hal_run(const struct hal_task *tasks, size_t count);
void hal_timer(size_t task, uint64_t at); /* HAL_NEVER stops it */
uint64_t hal_now(void);

const struct mu_config *hal_config(void);

enum hal_feed { HAL_PRIMARY, HAL_SECONDARY };
enum hal_sleep { HAL_AWAKE, HAL_DEEP };
enum hal_rail {
    HAL_MU_ASLEEP, HAL_MU_ACTIVE, HAL_OXYGEN, HAL_PRESSURE, HAL_TEMPERATURE, HAL_TURBIDITY, HAL_PI, HAL_MODEM,
    HAL_MODEM_RECEIVING, HAL_MODEM_TRANSMITTING, HAL_WIFI, HAL_GSM, HAL_BLUETOOTH, HAL_MOTORS
};
enum hal_way { HAL_SINK, HAL_FLOAT, HAL_HOVER };

bool hal_charger(void);
bool hal_at_surface(void);
bool hal_at_safe_level(void); /* the backup battery feeds the board, and is down to its safe level */
enum hal_feed hal_feed(void);
void hal_rails(uint16_t modules, enum hal_sleep sleep); /* bits of hal_rail; the core's own follow from its sleep */
uint16_t hal_powered(void);
void hal_stay_awake(uint64_t ms);
void hal_motors(enum hal_way way, uint32_t depth_mm);
void hal_send_sound(const void *data, size_t size);
void hal_send_wifi(const void *data, size_t size);
void hal_send_report(const void *data, size_t size);

uint64_t hal_clock(void); /* the clock chip's reading in ms */
void hal_set_clock(uint64_t reading);
uint64_t hal_clock_age(void); /* ms since it was set */
void hal_clock_alarm(uint64_t reading); /* HAL_NEVER for none */

/* What outlives a reset: two registers, the settings, and the flash. */
enum hal_register { HAL_SAMPLES, HAL_ACKNOWLEDGED };
uint32_t hal_load(enum hal_register at);
void hal_store(enum hal_register at, uint32_t value);
struct hal_settings {
    uint32_t alarm_ms, sample_ms, frame_ms, slot_ms, guard_ms;
    uint16_t slot;
    int32_t offset_ms;
};
struct hal_settings hal_load_settings(void);
void hal_store_settings(const struct hal_settings *settings);
void hal_set_level(uint8_t which, uint16_t value); /* 0 safe, 1 switch-back, 2 low, in 1/65535 */
bool hal_flash_read(uint32_t at, void *data, uint16_t size); /* erased bytes are 0 */
bool hal_flash_program(uint32_t at, const void *data, uint16_t size);
bool hal_flash_erase(uint16_t page);

struct hal_charges {
    uint16_t primary, secondary; /* in 1/65535 */
    uint8_t primary_short, secondary_short; /* in 1/255 */
};
struct hal_charges hal_charges(void);
struct hal_place {
    int32_t north_cm, east_cm;
    uint16_t depth_cm;
};
struct hal_place hal_place(void);
bool hal_sensor(unsigned sensor, uint16_t *counts, bool *saturated); /* false if it does not answer */

uint16_t hal_crc(const uint8_t *data, size_t size);
void hal_tell_state(uint8_t state);     /* for records */
void hal_refuse(const char *text);      /* counts an input without use */
void hal_fault(const char *text);       /* for the log */

#endif
