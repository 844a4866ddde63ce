/* The packets with the board's status, and the task that answers pings. */
#include "board.h"

#include <stdio.h>

#define STATUS_TAG 0xA0

static uint16_t sequence;
static bool is_answering;

void put_bytes(uint8_t **at, uint64_t value, unsigned bytes) {
    while (bytes--) {
        *(*at)++ = (uint8_t)value;
        value >>= 8;
    }
}

uint64_t get_bytes(const uint8_t *at, unsigned bytes) {
    uint64_t value = 0;
    while (bytes--)
        value = value << 8 | at[bytes];
    return value;
}

size_t seal(uint8_t *packet, uint8_t *end) {
    put_bytes(&end, hal_crc(packet, (size_t)(end - packet)), 2);
    return (size_t)(end - packet);
}

static void put_status(uint8_t **at, uint8_t version, uint8_t kind) {
    struct hal_charges charges = hal_charges();
    struct hal_place place = hal_place();
    put_bytes(at, version, 1);
    put_bytes(at, kind, 1);
    put_bytes(at, hal_config()->id, 2);
    put_bytes(at, sequence++, 2);
    put_bytes(at, board.state, 1);
    put_bytes(at, charges.primary, 2);
    put_bytes(at, charges.secondary, 2);
    put_bytes(at, (uint32_t)place.north_cm, 4);
    put_bytes(at, (uint32_t)place.east_cm, 4);
    put_bytes(at, place.depth_cm, 2);
    put_bytes(at, hal_clock(), 8);
    for (unsigned n = 0; n < HAL_SENSORS; n++)
        put_bytes(at, log_state.counts[n], 2);
    put_bytes(at, log_state.next, 4);
}

static void send_short(void) {
    uint8_t packet[7], *at = packet;
    struct hal_charges charges = hal_charges();
    sequence++;
    put_bytes(&at, STATUS_TAG | board.state, 1);
    put_bytes(&at, hal_config()->id, 2);
    put_bytes(&at, charges.primary_short, 1);
    put_bytes(&at, charges.secondary_short, 1);
    hal_send_sound(packet, seal(packet, at));
}

void report_by_sound(void) {
    uint8_t packet[64], *at = packet;
    if (hal_config()->modem == 2) {
        send_short();
        return;
    }
    uint32_t waiting = log_state.next - log_waiting_from();
    put_status(&at, 2, 13);
    put_bytes(&at, waiting < UINT16_MAX ? waiting : UINT16_MAX, 2);
    hal_send_sound(packet, seal(packet, at));
}

static size_t wifi_status(uint8_t *packet) {
    uint8_t *at = packet;
    bool overwrote = log_state.oldest > log_state.acknowledged;
    put_status(&at, 2, 14);
    put_bytes(&at, log_state.acknowledged, 4);
    put_bytes(&at, log_state.oldest, 4);
    put_bytes(&at, overwrote ? log_state.oldest - log_state.acknowledged : 0, 4);
    put_bytes(&at, log_state.torn < UINT16_MAX ? log_state.torn : UINT16_MAX, 2);
    put_bytes(&at, board.reset_cause, 1);
    put_bytes(&at, hal_feed(), 1);
    put_bytes(&at, hal_powered(), 2);
    put_bytes(&at, (uint32_t)clock_offset(), 4);
    return seal(packet, at);
}

void report_by_wifi(void) {
    uint8_t packet[80];
    hal_send_wifi(packet, wifi_status(packet));
}

void ping_heard(void) {
    const struct mu_config *config = hal_config();
    if (is_answering) {
        hal_refuse("a ping before the last one was answered");
        return;
    }
    is_answering = true;
    hal_timer(ANSWER_TASK, hal_now() + config->turnaround_ms);
    hal_stay_awake(config->turnaround_ms + config->answer_ms);
}

void answer_timer(void) {
    is_answering = false;
    if (takes(board.state, PING_HEARD)) {
        send_short();
        return;
    }
    char text[64];
    snprintf(text, sizeof text, "an answer: it is %s by now", STATE_NAMES[board.state]);
    hal_refuse(text);
}

void report_event(const struct hal_event *event) {
    uint8_t packet[80];
    if (event->kind == HAL_REPORT)
        hal_send_report(packet, wifi_status(packet));
}
