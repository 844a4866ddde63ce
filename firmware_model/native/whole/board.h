/* The parts of the whole board's firmware, and what they share. docs/firmware-states.md and docs/packets.md are its
 * requirements; firmware_model/whole_firmware.py decides alike. */
#ifndef BOARD_H
#define BOARD_H

#include "hal.h"

enum state {
    OFF, BOOTING, ACTIVE, SURFACING, FLOATING, CHARGING, RELEASED, SINKING, EMPTY, SLEEPING, SAMPLING, PROCESSING,
    AWAITING_SLOT, TRANSMITTING, HOVERING, REPORTING, CALLING,
    LOST, /* without power: the bench tells it */
    AWAITING_BEACON, STATES
};

enum trigger {
    POWER_CAME_ON, BOOTED_ON_BOTTOM, BOOTED_AT_SURFACE, BOOTED_ON_CHARGER, PERMISSION_HEARD, SURFACE_REACHED,
    CHARGE_EDGE_ROSE, CHARGE_EDGE_FELL, CLEAR_TO_SINK, FLOAT_TIMED_OUT, BOTTOM_REACHED, BATTERY_EMPTIED, ALARM_RANG,
    WAKE_OVER, SAMPLES_TO_PROCESS, SAMPLES_TO_SEND, PROCESSED, SLOT_OPENED, PING_HEARD, HOVER_ORDERED, HOVER_DUE,
    LAST_RESORT_CALL, LAST_RESORT_SURFACE, LOW_LEVEL_REACHED, CLOCK_DOUBTED, BEACON_HEARD, SINK_ORDERED,
    SURFACING_TIMED_OUT, TRIGGERS
};

/* The tasks, in the order of their timers. */
enum task { PIN_TASK, STATE_TASK, ANSWER_TASK, COMMAND_TASK, TASKS };

/* states.c: the transition table */
bool takes(enum state state, enum trigger trigger);
enum state next_state(enum state state, enum trigger trigger);
extern const char *const STATE_NAMES[], *const TRIGGER_NAMES[];

/* state_task.c: the state, what is switched in it, and when it ends by itself */
extern struct board {
    enum state state;
    uint8_t reset_cause;
    bool clear_to_sink;          /* the release came before the falling edge was certain */
    uint32_t commanded_mm;       /* the depth to hover at */
    uint64_t stays_down_until;   /* no last resort brings it up before */
    uint64_t last_resort;        /* the latest one since the charger was last seen; HAL_NEVER for none */
} board;
void apply(enum trigger trigger);
void apply_if_allowed(enum trigger trigger);
void renew_deadline(void);
void state_event(const struct hal_event *event);
void state_timer(void);

/* pin_task.c: the charger's pin, debounced */
void pin_event(const struct hal_event *event);
void pin_timer(void);
bool pin_is_high(void);
void pin_check(void); /* finds an edge whose interrupt was lost */

/* command_task.c */
void command_event(const struct hal_event *event);

/* clock.c: the clock chip's time, and the settings that an aPad changes */
extern struct hal_settings settings;
void clock_start(void);
void clock_pass_over(void);      /* alarms up to now do not ring any more */
uint64_t clock_next_alarm(void); /* the reading at which the wake's alarm rings next */
void clock_rang(void);
void clock_set(uint64_t reading);
uint64_t clock_slot(bool *doubted); /* the reading at which the board may transmit */
int32_t clock_offset(void);
void settings_changed(void);

/* sample_log.c: samples in flash, and their upload */
struct log_state {
    uint32_t next, acknowledged, oldest, torn;
    uint16_t counts[HAL_SENSORS]; /* of the newest sample */
};
extern struct log_state log_state;
void log_open(void);
void log_sample(void);
void log_upload(void);
bool log_acknowledge(uint32_t next); /* false for records that were never taken */
uint32_t log_waiting_from(void);

/* reports.c: the packets with the board's status */
void put_bytes(uint8_t **at, uint64_t value, unsigned bytes); /* little-endian */
uint64_t get_bytes(const uint8_t *at, unsigned bytes);
size_t seal(uint8_t *packet, uint8_t *end); /* with its check: the size */
void report_start(void);
void report_by_sound(void);
void report_by_wifi(void);
void ping_heard(void);
void report_event(const struct hal_event *event);
void answer_timer(void);

#endif
