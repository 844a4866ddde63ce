/* The log of samples: a ring of records in flash, and its upload. docs/packets.md has the bytes of both. */
#include "board.h"

#define RECORD 24u
#define A_PAGE (HAL_PAGE_BYTES / RECORD)
#define AT_ONCE 18u
#define PACKETS_AT_ONCE 4u
#define CHUNK (1000u / RECORD) /* records that are read at once: an answer of the port has 1024 bytes at most */
#define UNKNOWN UINT32_MAX

struct log_state log_state;
static uint32_t sent; /* the first sequence that this upload has not sent */

static uint32_t page_of(uint32_t sequence) { return sequence / A_PAGE % HAL_PAGES; }

static uint32_t address_of(uint32_t sequence) {
    return page_of(sequence) * HAL_PAGE_BYTES + sequence % A_PAGE * RECORD;
}

static uint32_t oldest_of(uint32_t next) {
    uint32_t page = next / A_PAGE;
    return page + 2 > HAL_PAGES ? (page + 2 - HAL_PAGES) * A_PAGE : 0;
}

static bool is_blank(const uint8_t *record) {
    for (unsigned n = 0; n < RECORD; n++)
        if (record[n])
            return false;
    return true;
}

/* The record's sequence; UNKNOWN for one that is not whole. */
static uint32_t sequence_of(const uint8_t *record) {
    bool whole = record[0] == 1 && get_bytes(record + RECORD - 2, 2) == hal_crc(record, RECORD - 2);
    return whole ? (uint32_t)get_bytes(record + 2, 4) : UNKNOWN;
}

/* How many records of a page are not blank, up to the last of them; the sequence of its first one, and the unreadable. */
static uint32_t written(uint32_t page, uint32_t *first, uint32_t *unreadable) {
    static uint8_t records[CHUNK * RECORD];
    uint32_t used = 0;
    *first = UNKNOWN;
    *unreadable = 0;
    for (uint32_t place = 0; place < A_PAGE; place++) {
        const uint8_t *record = records + place % CHUNK * RECORD;
        uint32_t rest = A_PAGE - place < CHUNK ? A_PAGE - place : CHUNK;
        if (place % CHUNK == 0 && !hal_flash_read(page * HAL_PAGE_BYTES + place * RECORD, records, (uint16_t)(rest * RECORD)))
            return used;
        if (is_blank(record))
            continue;
        *unreadable += place - used; /* blank ones in between are torn, too */
        used = place + 1;
        uint32_t sequence = sequence_of(record);
        if (sequence == UNKNOWN)
            ++*unreadable;
        else if (*first == UNKNOWN)
            *first = sequence - place;
    }
    return used;
}

/* Finds the end of the log after a reset. `known` comes from a register: records that are missing before it are torn. */
static void recover(uint32_t known) {
    uint32_t first, newest = 0, end = 0, unreadable = 0, torn = 0, used, count, unwritable = 0;
    bool found = false;
    for (uint32_t page = 0; page < HAL_PAGES; page++) {
        used = written(page, &first, &count);
        if (first == UNKNOWN || (found && first < newest))
            continue;
        found = true;
        newest = first;
        end = first + used;
        unreadable = count;
    }
    if (known < end)
        known = end;
    torn = unreadable + known - end;
    used = written(page_of(known), &first, &count);
    if (first != UNKNOWN && first != known - known % A_PAGE)
        unwritable = (A_PAGE - known % A_PAGE) % A_PAGE; /* the page was never erased for these */
    else if (used > known % A_PAGE && (known % A_PAGE || used == 1)) /* more at a page's begin are of the former round */
        unwritable = used - known % A_PAGE;
    log_state.torn = torn + unwritable;
    log_state.next = known + unwritable;
}

void log_open(void) {
    uint32_t known = hal_load(HAL_SAMPLES);
    uint8_t record[RECORD];
    log_state.acknowledged = hal_load(HAL_ACKNOWLEDGED);
    recover(known);
    if (log_state.next != known)
        hal_store(HAL_SAMPLES, log_state.next);
    uint32_t oldest = oldest_of(log_state.next), newest = log_state.next - 1;
    log_state.oldest = oldest < log_state.next ? oldest : log_state.next;
    if (log_state.next && newest >= log_state.oldest && hal_flash_read(address_of(newest), record, RECORD) &&
        sequence_of(record) == newest)
        for (unsigned n = 0; n < HAL_SENSORS; n++)
            log_state.counts[n] = (uint16_t)get_bytes(record + 14 + 2 * n, 2);
}

void log_sample(void) {
    uint8_t record[RECORD], *at = record, saturated = 0;
    uint32_t sequence = log_state.next, address = address_of(sequence);
    for (unsigned n = 0; n < HAL_SENSORS; n++) {
        bool outside = false;
        if (!hal_sensor(n, &log_state.counts[n], &outside))
            hal_fault("a sensor does not answer");
        saturated = (uint8_t)(saturated | outside << n);
    }
    put_bytes(&at, 1, 1);
    put_bytes(&at, saturated, 1);
    put_bytes(&at, sequence, 4);
    put_bytes(&at, hal_clock(), 8);
    for (unsigned n = 0; n < HAL_SENSORS; n++)
        put_bytes(&at, log_state.counts[n], 2);
    seal(record, at);
    if (address % HAL_PAGE_BYTES == 0 && !hal_flash_erase((uint16_t)page_of(sequence)))
        hal_fault("a page of the flash was not erased");
    if (!hal_flash_program(address, record, RECORD))
        hal_fault("a record was not written");
    log_state.next = sequence + 1;
    log_state.oldest = oldest_of(sequence + 1);
    hal_store(HAL_SAMPLES, log_state.next);
}

uint32_t log_waiting_from(void) {
    return log_state.oldest > log_state.acknowledged ? log_state.oldest : log_state.acknowledged;
}

/* One packet with the readable records from `first` up to and without `until`. */
static void send_records(uint32_t first, uint32_t until) {
    static uint8_t packet[15 + AT_ONCE * RECORD];
    uint8_t *at = packet;
    put_bytes(&at, 2, 1);
    put_bytes(&at, 15, 1);
    put_bytes(&at, hal_config()->id, 2);
    put_bytes(&at, log_waiting_from(), 4);
    put_bytes(&at, first, 4);
    put_bytes(&at, until - first, 1);
    for (uint32_t sequence = first; sequence < until; sequence++)
        if (sequence >= log_state.oldest && hal_flash_read(address_of(sequence), at, RECORD) && sequence_of(at) == sequence)
            at += RECORD;
    hal_send_wifi(packet, seal(packet, at));
}

static void send_waiting(void) {
    uint32_t oldest = log_waiting_from(), until = oldest + PACKETS_AT_ONCE * AT_ONCE;
    if (until > log_state.next)
        until = log_state.next;
    while (sent < until) {
        uint32_t first = sent;
        sent = first + AT_ONCE < until ? first + AT_ONCE : until;
        send_records(first, sent);
    }
}

void log_upload(void) {
    sent = log_waiting_from();
    send_waiting();
}

bool log_acknowledge(uint32_t next) {
    if (next > log_state.next)
        return false;
    if (next <= log_state.acknowledged) {
        log_upload();
        return true;
    }
    log_state.acknowledged = next;
    hal_store(HAL_ACKNOWLEDGED, next);
    if (sent < log_waiting_from())
        sent = log_waiting_from();
    send_waiting();
    return true;
}
