/* The port of an MU board of musselbed for firmware in C99: docs/firmware-port.md. One board a process, no allocation. */
#ifndef MUSSELBED_H
#define MUSSELBED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board_config.h"

#define MU_HZ 32768u /* of the board's counter, which wraps after 36 hours */
#define MU_MAX_PAYLOAD 1024

enum mu_input {
    MU_CHARGER,
    MU_SURFACE,
    MU_BOTTOM,
    MU_BATTERY_EMPTY,
    MU_CLOCK, /* this and the rest are a whole board's */
    MU_SAFE_LEVEL,
    MU_ON_SECONDARY,
    MU_LOW_LEVEL = 8, /* from here on lines that interrupt, and have no level */
    MU_SWITCH_BACK,
    MU_REPORT
};
enum mu_output { MU_CHARGE, MU_MOTOR_UP, MU_MOTOR_DOWN, MU_WATCH_BATTERY };
enum mu_uart { MU_MODEM, MU_WIFI, MU_REPORT_LINE };
enum mu_adc { MU_PRIMARY, MU_SECONDARY }; /* 65535 counts are a full battery */
enum mu_cause { MU_POWER_ON, MU_BROWN_OUT, MU_WATCHDOG };
enum mu_sleep { MU_AWAKE, MU_DEEP_SLEEP };

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
    const uint8_t *data; /* until the next mu_wait, mu_adc, mu_i2c or mu_flash call */
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

/* A whole board's. The three calls that answer return false for no answer, or an error. */
void mu_sleep_mode(enum mu_sleep mode);                   /* between turns, from the end of this one on */
bool mu_i2c(uint8_t address, const void *out, size_t out_size, void *in, uint8_t in_size); /* up to 255 bytes out */
bool mu_flash_read(uint32_t at, void *data, uint16_t size);
bool mu_flash_program(uint32_t at, const void *data, uint16_t size); /* erased bytes of one page, up to 255 */
bool mu_flash_erase(uint16_t page);
void mu_busy(uint32_t ms);                                /* the core of a sleeping board stays awake */
void mu_kick(uint32_t ms);                                /* starts the watchdog, or serves it; 0 stops it */

uint16_t mu_crc(const uint8_t *data, size_t size);        /* CRC-16/CCITT, as packets have it too */

#endif
