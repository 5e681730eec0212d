/* The least that answers an attitude with surfaces: responder LINK PRIORITY AWAKE_NS.
 * It says who it is once, and reads whatever else comes.  So long before and after an attitude is
 * expected it waits awake, as the module does; 0: it sleeps until something comes. */
#include "common.h"
#include "common/mavlink.h"

enum { PERIOD_NS = 5000000, SMOOTH = 16 };

static int is_ready(int fd, int64_t for_ns)
{
    struct timespec wait = { for_ns / 1000000000LL, for_ns % 1000000000LL };
    struct pollfd waiting = { fd, POLLIN, 0 };
    return ppoll(&waiting, 1, &wait, NULL) > 0;
}

/* Asleep, then awake around the expected time, then asleep again. */
static void wait_for(int fd, int64_t expected, int64_t awake)
{
    int64_t left = expected - awake - now_ns();
    if (awake > 0 && left > -2 * awake) {
        if (left > 0 && is_ready(fd, left)) {
            return;
        }
        while (now_ns() < expected + awake) {
            if (is_ready(fd, 0)) {
                return;
            }
        }
    }
    while (!is_ready(fd, 1000000000LL)) {
    }
}

/* When the next one comes, by when this one came. */
static int64_t next_of(int64_t expected, int64_t arrival)
{
    int64_t off = arrival - expected;
    if (off < -PERIOD_NS / 2 || off > PERIOD_NS / 2) {
        return arrival + PERIOD_NS;
    }
    return expected + off / SMOOTH + PERIOD_NS;
}

int main(int argc, char **argv)
{
    if (argc != 4) {
        return 2;
    }
    int fd = open_link(argv[1]);
    int64_t awake = atoll(argv[3]), expected = 0;
    be_on_time(atoi(argv[2]));
    uint8_t in[4096], out[MAVLINK_MAX_PACKET_LEN];
    mavlink_message_t message;
    mavlink_status_t status;
    mavlink_msg_heartbeat_pack(1, 191, &message, MAV_TYPE_ONBOARD_CONTROLLER,
                               MAV_AUTOPILOT_INVALID, 0, 0, MAV_STATE_ACTIVE);
    if (write(fd, out, mavlink_msg_to_send_buffer(out, &message)) < 0) {
        return 1;
    }
    for (;;) {
        wait_for(fd, expected, awake);
        int64_t arrival = now_ns();
        ssize_t size = read(fd, in, sizeof in);
        if (size <= 0) {
            return 0;
        }
        for (ssize_t i = 0; i < size; i++) {
            if (!mavlink_parse_char(MAVLINK_COMM_0, in[i], &message, &status)
                || message.msgid != MAVLINK_MSG_ID_ATTITUDE_QUATERNION) {
                continue;
            }
            mavlink_attitude_quaternion_t attitude;
            mavlink_msg_attitude_quaternion_decode(&message, &attitude);
            uint16_t pulse = 1500 + (int)(400.0f * attitude.q3);
            mavlink_msg_rc_channels_override_pack(255, 191, &message, 1, 1, pulse, pulse, pulse,
                pulse, 65535, 65535, 65535, 65535, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
            if (write(fd, out, mavlink_msg_to_send_buffer(out, &message)) < 0) {
                return 1;
            }
            expected = next_of(expected, arrival);
        }
    }
}
