/* See musselbed.h. POSIX: read, write, getenv. */
#include "musselbed.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define HEAD 12
#define MAX_BODY (HEAD + MU_MAX_PAYLOAD + 2)
#define MAX_ENCODED (MAX_BODY + MAX_BODY / 254 + 2)

enum to_board { HELLO = 1, RESET, RUN, PIN, UART_RX, ADC };
enum from_board { HELLO_FROM = 65, SLEEP, PIN_FROM, UART_TX, ADC_READ, STATE, LOG };

static int port_fd = -1;
static bool ended;
static struct mu_config config;
static uint32_t now, sent, received, alarm_at;
static bool has_alarm, runs;
static uint8_t levels, interrupts;
static uint8_t in[4096], frame[MAX_ENCODED], out[8192];
static size_t in_at, in_size, out_size;

static uint16_t get16(const uint8_t *at) { return (uint16_t)(at[0] | at[1] << 8); }

static uint32_t get32(const uint8_t *at) { return get16(at) | (uint32_t)get16(at + 2) << 16; }

static void put16(uint8_t *at, uint16_t value) {
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *at, uint32_t value) {
    put16(at, (uint16_t)value);
    put16(at + 2, (uint16_t)(value >> 16));
}

uint16_t mu_crc(const uint8_t *data, size_t size) {
    uint16_t crc = 0xFFFF;
    while (size--) {
        crc ^= (uint16_t)(*data++ << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

static void flush(void) {
    size_t done = 0;
    while (done < out_size && !ended) {
        ssize_t count = write(port_fd, out + done, out_size - done);
        if (count > 0)
            done += (size_t)count;
        else if (errno != EINTR)
            ended = true;
    }
    out_size = 0;
}

/* COBS: each zero byte becomes the distance to the next one. */
static void stuff(const uint8_t *data, size_t size) {
    if (out_size + MAX_ENCODED > sizeof out)
        flush();
    size_t code_at = out_size++;
    uint8_t code = 1;
    for (size_t n = 0; n < size; n++) {
        if (data[n]) {
            out[out_size++] = data[n];
            code++;
        }
        if (!data[n] || code == 0xFF) {
            out[code_at] = code;
            code = 1;
            code_at = out_size++;
        }
    }
    out[code_at] = code;
    out[out_size++] = 0;
}

static void send_frame(enum from_board kind, uint8_t port, const void *payload, size_t size) {
    static uint8_t body[MAX_BODY];
    if (size > MU_MAX_PAYLOAD)
        size = MU_MAX_PAYLOAD;
    body[0] = (uint8_t)kind;
    body[1] = port;
    put16(body + 2, (uint16_t)size);
    put32(body + 4, now);
    put32(body + 8, sent++);
    if (size)
        memcpy(body + HEAD, payload, size);
    put16(body + HEAD + size, mu_crc(body, HEAD + size));
    stuff(body, HEAD + size + 2);
}

/* The next byte of the stream; -1 at its end. */
static int next_byte(void) {
    while (in_at == in_size) {
        ssize_t count = read(port_fd, in, sizeof in);
        if (count == 0 || (count < 0 && errno != EINTR))
            return -1;
        in_at = 0;
        in_size = count > 0 ? (size_t)count : 0;
    }
    return in[in_at++];
}

/* Undoes COBS in place: the size of the body, or 0 for bytes that are none. */
static size_t unstuff(uint8_t *data, size_t size) {
    size_t from = 0, to = 0;
    while (from < size) {
        uint8_t code = data[from++];
        if (from + code - 1 > size)
            return 0;
        for (uint8_t n = 1; n < code; n++)
            data[to++] = data[from++];
        if (code < 0xFF && from < size)
            data[to++] = 0;
    }
    return to;
}

/* Reads a whole frame into `frame`: its type, or 0 at the end. Damaged frames are passed over, as on a serial line. */
static uint8_t read_frame(size_t *payload) {
    while (!ended) {
        size_t size = 0;
        int byte;
        while ((byte = next_byte()) > 0)
            if (size < sizeof frame)
                frame[size++] = (uint8_t)byte;
        if (byte < 0) {
            ended = true;
            break;
        }
        size = unstuff(frame, size);
        if (size < HEAD + 2 || get16(frame + 2) != size - HEAD - 2 ||
            get16(frame + size - 2) != mu_crc(frame, size - 2) || get32(frame + 8) != received)
            continue;
        received++;
        now = get32(frame + 4);
        *payload = size - HEAD - 2;
        return frame[0];
    }
    return 0;
}

static void greeted(const uint8_t *hello, const char *name) {
    uint8_t answer[64];
    size_t size = strlen(name) < sizeof answer - 2 ? strlen(name) : sizeof answer - 2;
    config.id = get16(hello + 2);
    config.seed = get32(hello + 4);
    config.debounce_ms = get32(hello + 8);
    config.boot_ms = get32(hello + 12);
    config.surfacing_timeout_ms = get32(hello + 16);
    config.float_timeout_ms = get32(hello + 20);
    config.release_wait_ms = get32(hello + 24);
    put16(answer, MU_VERSION);
    memcpy(answer + 2, name, size);
    send_frame(HELLO_FROM, 0, answer, size + 2);
}

bool mu_open(const char *name) {
    const char *number = getenv("MUSSELBED_PORT");
    size_t size = 0;
    if (number)
        port_fd = atoi(number);
    if (port_fd < 0) {
        fputs("no MUSSELBED_PORT: start this program by `musselbed mu run`, or in a fleet\n", stderr);
        return false;
    }
    if (read_frame(&size) != HELLO || size != 28)
        return false;
    if (get16(frame + HEAD) != MU_VERSION) {
        fputs("the bench speaks another version of the port\n", stderr);
        return false;
    }
    greeted(frame + HEAD, name);
    return true;
}

/* Reads the next interrupt of this turn. */
static bool interrupted(struct mu_event *event) {
    size_t size = 0;
    uint8_t kind = read_frame(&size), *payload = frame + HEAD;
    interrupts--;
    *event = (struct mu_event){MU_UART, frame[1], size && payload[0], payload, size};
    if (kind == RESET)
        *event = (struct mu_event){MU_RESET, payload[0], false, NULL, 0};
    else if (kind == PIN)
        event->kind = MU_PIN;
    return kind == RESET || kind == PIN || kind == UART_RX; /* a later version may have more */
}

bool mu_wait(struct mu_event *event) {
    for (;;) {
        while (runs && interrupts && !ended)
            if (interrupted(event))
                return true;
        if (runs && has_alarm && mu_reached(alarm_at)) {
            has_alarm = false;
            *event = (struct mu_event){MU_ALARM, 0, false, NULL, 0};
            return true;
        }
        if (runs) {
            uint8_t at[4];
            put32(at, alarm_at);
            send_frame(SLEEP, has_alarm, at, has_alarm ? 4 : 0);
            flush();
            runs = false;
        }
        size_t size = 0;
        uint8_t kind = read_frame(&size);
        if (!kind)
            return false;
        if (kind == RUN && size == 2) {
            levels = frame[HEAD];
            interrupts = frame[HEAD + 1];
            runs = true;
        }
    }
}

bool mu_sleep_until(uint32_t at, void (*handle)(const struct mu_event *)) {
    struct mu_event event;
    mu_alarm(at);
    while (mu_wait(&event)) {
        if (event.kind == MU_ALARM)
            return true;
        handle(&event);
        if (!has_alarm)
            mu_alarm(at);
    }
    return false;
}

const struct mu_config *mu_config(void) { return &config; }

uint32_t mu_now(void) { return now; }

void mu_alarm(uint32_t at) {
    alarm_at = at;
    has_alarm = true;
}

void mu_alarm_off(void) { has_alarm = false; }

bool mu_level(enum mu_input line) { return levels >> line & 1; }

void mu_pin(enum mu_output line, bool high) {
    uint8_t level = high;
    send_frame(PIN_FROM, (uint8_t)line, &level, 1);
}

void mu_send(enum mu_uart port, const void *data, size_t size) { send_frame(UART_TX, (uint8_t)port, data, size); }

uint16_t mu_adc(enum mu_adc channel) {
    size_t size = 0;
    send_frame(ADC_READ, (uint8_t)channel, NULL, 0);
    flush();
    while (!ended)
        if (read_frame(&size) == ADC && size == 2)
            return get16(frame + HEAD);
    return 0;
}

void mu_state(uint8_t state) { send_frame(STATE, 0, &state, 1); }

void mu_log(const char *text) { send_frame(LOG, 0, text, strlen(text)); }

void mu_refuse(const char *text) { send_frame(LOG, 1, text, strlen(text)); }
