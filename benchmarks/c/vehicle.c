/* A vehicle that asks several modules in turn, and times their answers:
 *
 *     vehicle SECONDS ENGAGE_AFTER PRIORITY ARRIVALS LINK...
 *
 * LINK is "udp:PORT" (we listen there) or "pty:NAME" (we make a pseudo-terminal and leave its
 * name in the file NAME).  In every period of 5 ms each module gets, in a part of it that is its
 * own, one piece with accelerations and an attitude, in every fourth a position and the servos'
 * outputs (what it was told) too.  ARRIVALS shifts the pieces of a period, those of all modules
 * alike: a number of ns moves them by anything up to that to either side; "loop:NS" delays half of
 * the periods by NS, as a vehicle does that sends in the steps of its main loop.  The stamps stay
 * regular.
 *
 * An answer may take as long as it likes: the next surfaces answer every piece that is still open,
 * and all of these count from the oldest.  To stdout, module by module: for every period the nanoseconds
 * from the piece to the surfaces, -1 where none came by the end. */
#include "common.h"
#include "common/mavlink.h"

enum { MODULES_MAX = 4, PERIOD_NS = 5000000 };

struct module {
    int fd;
    int is_socket;
    int is_known;
    struct sockaddr_in peer;
    mavlink_status_t in;
    mavlink_message_t rx;
    mavlink_status_t out;
    uint16_t servos[4];
    long asked;        /* pieces so far, and when the next is due */
    int64_t due;
    long open;         /* the oldest piece without an answer; none: as many as were asked */
    int64_t open_since;
    int64_t *took;     /* of every piece */
};

static void listen_to(struct module *m, const char *link)
{
    memset(m, 0, sizeof *m);
    if (strncmp(link, "udp:", 4) == 0) {
        struct sockaddr_in at = { .sin_family = AF_INET, .sin_port = htons(atoi(link + 4)) };
        inet_pton(AF_INET, "127.0.0.1", &at.sin_addr);
        m->is_socket = 1;
        m->fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
        if (m->fd < 0 || bind(m->fd, (struct sockaddr *)&at, sizeof at) != 0) {
            perror(link);
            exit(2);
        }
        return;
    }
    m->fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    struct termios t;
    FILE *told = fopen(link + 4, "w");
    if (m->fd < 0 || grantpt(m->fd) != 0 || unlockpt(m->fd) != 0 || told == NULL) {
        perror(link);
        exit(2);
    }
    const char *name = ptsname(m->fd);
    int near = open(name, O_RDWR | O_NOCTTY); /* stays open: the line does not hang up */
    tcgetattr(near, &t);
    cfmakeraw(&t);
    tcsetattr(near, TCSANOW, &t);
    fputs(name, told);
    fclose(told);
}

static void send_all(struct module *m, const uint8_t *data, size_t size)
{
    ssize_t sent = m->is_socket
        ? sendto(m->fd, data, size, 0, (struct sockaddr *)&m->peer, sizeof m->peer)
        : write(m->fd, data, size);
    (void)sent; /* what is lost shows as an answer that does not come */
}

/* Reads what has come; whether surfaces were among it. */
static int has_surfaces(struct module *m)
{
    uint8_t data[4096];
    int found = 0;
    for (;;) {
        socklen_t length = sizeof m->peer;
        ssize_t size = m->is_socket
            ? recvfrom(m->fd, data, sizeof data, 0, (struct sockaddr *)&m->peer, &length)
            : read(m->fd, data, sizeof data);
        if (size <= 0) {
            return found;
        }
        mavlink_message_t message;
        mavlink_status_t status;
        for (ssize_t i = 0; i < size; i++) {
            if (mavlink_frame_char_buffer(&m->rx, &m->in, data[i], &message, &status) == 1) {
                m->is_known = 1;
                if (message.msgid == MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE) {
                    mavlink_rc_channels_override_t told;
                    mavlink_msg_rc_channels_override_decode(&message, &told);
                    uint16_t pulses[4] = { told.chan1_raw, told.chan2_raw, told.chan3_raw,
                                           told.chan4_raw };
                    memcpy(m->servos, pulses, sizeof pulses);
                    found = 1;
                }
            }
        }
    }
}

static size_t add(struct module *m, mavlink_message_t *message, uint8_t system, uint8_t component,
                  uint8_t *to)
{
    const mavlink_msg_entry_t *e = mavlink_get_msg_entry(message->msgid);
    mavlink_finalize_message_buffer(message, system, component, &m->out, e->min_msg_len,
                                    e->max_msg_len, e->crc_extra);
    return mavlink_msg_to_send_buffer(to, message);
}

static size_t piece(struct module *m, long tick, int engage, uint8_t *to)
{
    mavlink_message_t msg;
    uint32_t ms = 5 * tick;
    float wave = 0.01f * (tick % 20 - 10); /* nothing that is measured stands still */
    size_t n = 0;
    if (tick % 200 == 0) {
        mavlink_msg_heartbeat_pack(1, 1, &msg, MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA,
                                   MAV_MODE_FLAG_SAFETY_ARMED | MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
                                       | MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
                                   0, MAV_STATE_ACTIVE);
        n += add(m, &msg, 1, 1, to + n);
    }
    if (engage) {
        char name[16] = "OP_ENGAGE";
        mavlink_msg_param_set_pack(255, 190, &msg, 1, 191, name, 1.0f, MAV_PARAM_TYPE_REAL32);
        n += add(m, &msg, 255, 190, to + n);
    }
    if (tick % 4 == 0) {
        mavlink_msg_local_position_ned_pack(1, 1, &msg, ms, 0.2f + 0.001f * wave, 0.0f,
                                            -1.15f + 0.001f * wave, 0.01f * wave, 0.0f, 0.0f);
        n += add(m, &msg, 1, 1, to + n);
        mavlink_msg_servo_output_raw_pack(1, 1, &msg, 5000 * tick, 0, m->servos[0], m->servos[1],
                                          m->servos[2], m->servos[3], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
        n += add(m, &msg, 1, 1, to + n);
    }
    mavlink_msg_raw_imu_pack(1, 1, &msg, 5000ULL * tick, tick % 10, 0, -1000 + tick % 5, tick % 3,
                             0, 0, 0, 0, 0, 0, 0);
    n += add(m, &msg, 1, 1, to + n);
    float offset[4] = { 0 };
    mavlink_msg_attitude_quaternion_pack(1, 1, &msg, ms, 1.0f, 0.0f, 0.001f * wave, 0.0f, 0.0f,
                                         0.02f * wave, 0.0f, offset);
    return n + add(m, &msg, 1, 1, to + n);
}

struct arrivals {
    int64_t shift;
    int in_steps;
};

static struct arrivals arrivals_of(const char *text)
{
    if (strncmp(text, "loop:", 5) == 0) {
        return (struct arrivals) { atoll(text + 5), 1 };
    }
    return (struct arrivals) { atoll(text), 0 };
}

/* By how much a period's pieces are moved: the same for every module and in every run. */
static int64_t shift_of(struct arrivals a, long tick)
{
    uint64_t mixed = (uint64_t)tick + 1; /* splitmix64 */
    mixed *= 0x9e3779b97f4a7c15ULL;
    mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9ULL;
    mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111ebULL;
    mixed ^= mixed >> 31;
    if (a.in_steps) {
        return mixed & 1 ? a.shift : 0;
    }
    return a.shift == 0 ? 0 : (int64_t)(mixed % (2 * a.shift + 1)) - a.shift;
}

/* The surfaces that have come, if any, answer whatever is open. */
static void take_answers(struct module *m)
{
    int found = has_surfaces(m);
    int64_t took = now_ns() - m->open_since;
    for (; found && m->open < m->asked; m->open++) {
        m->took[m->open] = took;
    }
}

static void wait_until(struct module *modules, int count, int64_t due)
{
    struct pollfd waiting[MODULES_MAX];
    for (int64_t left; (left = due - now_ns()) > 0;) {
        struct timespec wait = { left / 1000000000LL, left % 1000000000LL };
        for (int i = 0; i < count; i++) {
            waiting[i] = (struct pollfd) { modules[i].fd, POLLIN, 0 };
        }
        if (ppoll(waiting, count, &wait, NULL) > 0) {
            for (int i = 0; i < count; i++) {
                if (waiting[i].revents != 0) {
                    take_answers(&modules[i]);
                }
            }
        }
    }
}

static void ask(struct module *m, long engage_at)
{
    uint8_t data[1024];
    int engage = m->asked >= engage_at && m->asked % 400 == engage_at % 400;
    take_answers(m); /* what came just now is of before */
    size_t size = piece(m, m->asked + 1, engage, data);
    if (m->open == m->asked) {
        m->open_since = now_ns();
    }
    m->took[m->asked++] = -1;
    send_all(m, data, size);
}

int main(int argc, char **argv)
{
    int count = argc - 5;
    if (count < 1 || count > MODULES_MAX) {
        return 2;
    }
    static struct module modules[MODULES_MAX];
    for (int i = 0; i < count; i++) {
        listen_to(&modules[i], argv[5 + i]);
    }
    puts("ready");
    fflush(stdout);
    for (int known = 0; known < count; usleep(1000)) {
        known = 0;
        for (int i = 0; i < count; i++) {
            has_surfaces(&modules[i]);
            known += modules[i].is_known;
        }
    }
    long ticks = 200 * atol(argv[1]), engage_at = 200 * atol(argv[2]);
    struct arrivals arrivals = arrivals_of(argv[4]);
    for (int i = 0; i < count; i++) {
        modules[i].took = malloc(ticks * sizeof *modules[i].took);
        memset(modules[i].took, 1, ticks * sizeof *modules[i].took);
    }
    be_on_time(atoi(argv[3]));
    int64_t begin = now_ns() + 2 * PERIOD_NS;
    for (int i = 0; i < count; i++) {
        modules[i].due = begin + i * PERIOD_NS / count + shift_of(arrivals, 0);
    }
    for (;;) {
        struct module *next = NULL;
        int place = 0;
        for (int i = 0; i < count; i++) {
            if (modules[i].asked < ticks && (next == NULL || modules[i].due < next->due)) {
                next = &modules[i];
                place = i;
            }
        }
        if (next == NULL) {
            break;
        }
        wait_until(modules, count, next->due);
        ask(next, engage_at);
        next->due = begin + next->asked * PERIOD_NS + place * PERIOD_NS / count
            + shift_of(arrivals, next->asked);
    }
    wait_until(modules, count, now_ns() + 200000000);
    for (int i = 0; i < count; i++) {
        if (fwrite(modules[i].took, sizeof *modules[i].took, ticks, stdout) != (size_t)ticks) {
            return 1;
        }
    }
    return 0;
}
