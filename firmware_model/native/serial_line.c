/* A serial line below musselbed.c: it leaves out damaged and repeated frames, repeats an answer that was lost, and says
 * when the board has begun anew. It stands in for `read` and `write`: on POSIX link it with -Wl,--wrap=read,--wrap=write; on
 * a microcontroller the two are those of its C library (newlib's _read and _write), and __real_* are those of its UART. */
#include "musselbed.h"

#include <string.h>
#include <sys/types.h>
#include <unistd.h>

#define HEAD 12
#define MAX_BODY (HEAD + MU_MAX_PAYLOAD + 2)
#define MAX_ENCODED (MAX_BODY + MAX_BODY / 254 + 2)
#define HELLO 1
#define RUN 3
#define OUT_OF_COUNT 0xFFFFFFFFu

ssize_t __real_read(int fd, void *data, size_t size);
ssize_t __real_write(int fd, const void *data, size_t size);
ssize_t __wrap_read(int fd, void *data, size_t size);
ssize_t __wrap_write(int fd, const void *data, size_t size);

/* "I have begun": HELLO (65) out of the count, version 1, as it is on the line. */
static const uint8_t BEGUN[] = {2, 65, 2, 2, 1, 1, 1, 1, 6, 255, 255, 255, 255, 1, 3, 191, 70, 0};

static uint8_t encoded[MAX_ENCODED], kept[4096], in[256];
static size_t encoded_size, handed_over, kept_size, in_at, in_size;
static uint32_t expected;
static bool has_begun, is_whole, has_overflowed;

static uint32_t get32(const uint8_t *at) {
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* Begins the program anew, as a reset of a microcontroller does; its memory is as it was loaded. */
static void restart(void) { execl("/proc/self/exe", "board", (char *)NULL); }

static void send_all(int fd, const uint8_t *data, size_t size) {
    while (size) {
        ssize_t count = __real_write(fd, data, size);
        if (count < 0)
            return; /* the line is gone: the bench asks again */
        data += count;
        size -= (size_t)count;
    }
}

/* The body of `encoded` without COBS and check; 0 for a damaged frame. */
static size_t decoded(uint8_t *body) {
    size_t from = 0, to = 0;
    while (from < encoded_size) {
        uint8_t code = encoded[from++];
        if (from + code - 1 > encoded_size)
            return 0;
        for (uint8_t n = 1; n < code; n++)
            body[to++] = encoded[from++];
        if (code < 0xFF && from < encoded_size)
            body[to++] = 0;
    }
    if (to < HEAD + 2 || (size_t)(body[2] | body[3] << 8) != to - HEAD - 2)
        return 0;
    return (body[to - 2] | body[to - 1] << 8) == mu_crc(body, to - 2) ? to - 2 : 0;
}

/* True if the frame is the next one of the exchange. Answers the others. */
static bool is_due(int fd) {
    static uint8_t body[MAX_ENCODED];
    if (!decoded(body))
        return false;
    uint32_t sequence = get32(body + 8);
    if (sequence == OUT_OF_COUNT && body[0] == HELLO && expected)
        restart();
    if (!expected && (sequence || body[0] != HELLO))
        send_all(fd, BEGUN, sizeof BEGUN);
    else if (sequence == expected) {
        if (body[0] == RUN && expected > 1) { /* the bench has the whole answer to the turn before */
            kept_size = 0;
            has_overflowed = false;
        }
        expected++;
        return true;
    } else if ((int32_t)(sequence - expected) < 0 && body[0] == RUN && !has_overflowed)
        send_all(fd, kept, kept_size);
    return false;
}

/* Reads up to the end of a frame that is due; false at the end of the line. */
static bool read_due(int fd) {
    if (!has_begun)
        send_all(fd, BEGUN, sizeof BEGUN);
    has_begun = true;
    for (;;) {
        if (in_at == in_size) {
            ssize_t count = __real_read(fd, in, sizeof in);
            if (count <= 0)
                return false;
            in_at = 0;
            in_size = (size_t)count;
        }
        uint8_t byte = in[in_at++];
        if (byte) {
            if (encoded_size < sizeof encoded)
                encoded[encoded_size++] = byte;
            continue;
        }
        if (encoded_size && is_due(fd)) {
            is_whole = true;
            handed_over = 0;
            return true;
        }
        encoded_size = 0;
    }
}

ssize_t __wrap_read(int fd, void *data, size_t size) {
    if (!is_whole && !read_due(fd))
        return 0;
    uint8_t *to = data;
    size_t count = 0;
    while (count < size && handed_over < encoded_size)
        to[count++] = encoded[handed_over++];
    if (count < size) {
        to[count++] = 0;
        encoded_size = 0;
        is_whole = false;
    }
    return (ssize_t)count;
}

ssize_t __wrap_write(int fd, const void *data, size_t size) {
    if (size <= sizeof kept - kept_size) {
        memcpy(kept + kept_size, data, size);
        kept_size += size;
    } else
        has_overflowed = true; /* such an answer cannot be repeated: the bench says that the turn did not end */
    send_all(fd, data, size);
    return (ssize_t)size;
}
