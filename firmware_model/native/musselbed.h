/* The port of an MU board of musselbed for firmware in C99: docs/firmware-port.md. One board a process, no allocation. */
#ifndef MUSSELBED_H
#define MUSSELBED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MU_VERSION 1
#define MU_HZ 32768u /* of the board's counter, which wraps after 36 hours */
#define MU_MAX_PAYLOAD 1024

enum mu_input { MU_CHARGER, MU_SURFACE, MU_BOTTOM, MU_BATTERY_EMPTY };
enum mu_output { MU_CHARGE, MU_MOTOR_UP, MU_MOTOR_DOWN, MU_WATCH_BATTERY };
enum mu_uart { MU_MODEM, MU_WIFI };
enum mu_adc { MU_PRIMARY, MU_SECONDARY }; /* 65535 counts are a full battery */
enum mu_cause { MU_POWER_ON, MU_BROWN_OUT, MU_WATCHDOG };

/* The scenario's numbers for its boards; firmware with numbers of its own ignores them. Milliseconds. */
struct mu_config {
    uint16_t id;
    uint32_t seed, debounce_ms, boot_ms, surfacing_timeout_ms, float_timeout_ms, release_wait_ms;
};

enum mu_kind {
    MU_RESET, /* `port` is the cause: always the first event */
    MU_PIN,   /* an interrupt of the line `port` */
    MU_UART,  /* `size` bytes at the UART `port` */
    MU_ALARM  /* the counter has reached the alarm, which is then off */
};

struct mu_event {
    enum mu_kind kind;
    uint8_t port;
    bool high;
    const uint8_t *data; /* until the next mu_wait or mu_adc */
    size_t size;
};

/* Opens the port with this name of the board. Returns false, with a line on stderr, outside of a bench. */
bool mu_open(const char *name);
/* Sleeps until something happens, and says what. False once the bench has ended: so should the program. */
bool mu_wait(struct mu_event *event);
/* Sleeps until the counter reaches `at`; other events go to `handle`. False once the bench has ended. */
bool mu_sleep_until(uint32_t at, void (*handle)(const struct mu_event *));

const struct mu_config *mu_config(void);
uint32_t mu_now(void);                                    /* the counter */
static inline uint32_t mu_ticks(uint32_t ms) {            /* rounded down; up to 36 hours */
    return (uint32_t)((uint64_t)ms * MU_HZ / 1000);
}
static inline bool mu_reached(uint32_t at) { return (int32_t)(mu_now() - at) >= 0; }
void mu_alarm(uint32_t at);                               /* one alarm, less than 2^31 ahead (18 hours) */
void mu_alarm_off(void);
bool mu_level(enum mu_input line);                        /* as this turn began */
void mu_pin(enum mu_output line, bool high);
void mu_send(enum mu_uart port, const void *data, size_t size);
uint16_t mu_adc(enum mu_adc channel);
void mu_state(uint8_t state);                             /* a state of docs/firmware-states.md, for records alone */
void mu_log(const char *text);
void mu_refuse(const char *text);                         /* an input that the firmware did not use: the bench counts it */

uint16_t mu_crc(const uint8_t *data, size_t size);        /* CRC-16/CCITT, as packets have it too */

#endif
