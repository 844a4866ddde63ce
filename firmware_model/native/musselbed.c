/* See musselbed.h. POSIX: read, write, getenv. */
#include "musselbed.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define HEAD 12
#define MAX_BODY (HEAD + MU_MAX_PAYLOAD + 2)
#define HELLO_SIZE 28
#define FOUR_MORE(name) +4
#define WHOLE_HELLO_SIZE (HELLO_SIZE + 5 MU_WHOLE_NUMBERS(FOUR_MORE)) /* its numbers, and what follows them */
#define MAX_ENCODED (MAX_BODY + MAX_BODY / 254 + 2)

enum to_board { HELLO = 1, RESET, RUN, PIN, UART_RX, ADC, I2C, FLASH };
enum from_board {
    HELLO_FROM = 65, SLEEP, PIN_FROM, UART_TX, ADC_READ, STATE, LOG,
    I2C_FROM, FLASH_READ, FLASH_PROGRAM, FLASH_ERASE, BUSY, KICK
};

static int port_fd = -1;
static bool ended;
static struct mu_config config;
static uint32_t now, sent, received, alarm_at;
static bool has_alarm, runs;
static uint8_t levels, interrupts, sleep_mode;
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

static void greeted_whole(const uint8_t *numbers) {
#define TAKE(name) config.name = get32(numbers), numbers += 4;
    MU_WHOLE_NUMBERS(TAKE)
#undef TAKE
    config.kept_on = get16(numbers);
    config.sleeps = numbers[2] & 1;
    config.doubts_clock = numbers[2] & 2;
    config.uses_secondary = numbers[2] & 4;
    config.last_resort = numbers[3];
    config.modem = numbers[4];
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
    if (read_frame(&size) != HELLO || size < HELLO_SIZE)
        return false;
    bool is_whole = size == WHOLE_HELLO_SIZE;
    if (get16(frame + HEAD) != MU_VERSION || (!is_whole && size != HELLO_SIZE)) {
        fputs("the bench speaks another version of the port: build with its board_config.h\n", stderr);
        return false;
    }
    greeted(frame + HEAD, name);
    if (is_whole)
        greeted_whole(frame + HEAD + HELLO_SIZE);
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
            send_frame(SLEEP, (uint8_t)(has_alarm | sleep_mode << 1), at, has_alarm ? 4 : 0);
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

/* Sends a question, and reads its answer into `in`; false if that is an error, or shorter. */
static bool ask(enum from_board kind, uint8_t port, const void *out, size_t out_size, enum to_board answer, void *in,
                size_t in_size) {
    size_t size = 0;
    send_frame(kind, port, out, out_size);
    flush();
    while (!ended)
        if (read_frame(&size) == answer) {
            if (size < in_size || (answer != ADC && frame[1]))
                return false;
            if (in_size)
                memcpy(in, frame + HEAD, in_size);
            return true;
        }
    return false;
}

uint16_t mu_adc(enum mu_adc channel) {
    uint8_t counts[2] = {0, 0};
    ask(ADC_READ, (uint8_t)channel, NULL, 0, ADC, counts, sizeof counts);
    return get16(counts);
}

void mu_sleep_mode(enum mu_sleep mode) { sleep_mode = (uint8_t)mode; }

bool mu_i2c(uint8_t address, const void *data, size_t size, void *in, uint8_t in_size) {
    uint8_t message[256];
    if (size > sizeof message - 1)
        return false;
    message[0] = in_size;
    if (size)
        memcpy(message + 1, data, size);
    return ask(I2C_FROM, address, message, size + 1, I2C, in, in_size);
}

bool mu_flash_read(uint32_t at, void *data, uint16_t size) {
    uint8_t message[6];
    put32(message, at);
    put16(message + 4, size);
    return ask(FLASH_READ, 0, message, sizeof message, FLASH, data, size);
}

bool mu_flash_program(uint32_t at, const void *data, uint16_t size) {
    uint8_t message[4 + 255];
    if (size > sizeof message - 4)
        return false;
    put32(message, at);
    memcpy(message + 4, data, size);
    return ask(FLASH_PROGRAM, 0, message, 4u + size, FLASH, NULL, 0);
}

bool mu_flash_erase(uint16_t page) {
    uint8_t message[2];
    put16(message, page);
    return ask(FLASH_ERASE, 0, message, sizeof message, FLASH, NULL, 0);
}

static void send_number(enum from_board kind, uint32_t number) {
    uint8_t payload[4];
    put32(payload, number);
    send_frame(kind, 0, payload, sizeof payload);
}

void mu_busy(uint32_t ms) { send_number(BUSY, ms); }

void mu_kick(uint32_t ms) { send_number(KICK, ms); }

void mu_state(uint8_t state) { send_frame(STATE, 0, &state, 1); }

void mu_log(const char *text) { send_frame(LOG, 0, text, strlen(text)); }

void mu_refuse(const char *text) { send_frame(LOG, 1, text, strlen(text)); }
