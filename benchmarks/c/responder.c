/* The least that answers an attitude with surfaces: responder LINK PRIORITY.
 * It says who it is once a second of attitudes, and reads whatever else comes. */
#include "common.h"
#include "common/mavlink.h"

int main(int argc, char **argv)
{
    if (argc != 3) {
        return 2;
    }
    int fd = open_link(argv[1]);
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
        struct pollfd waiting = { fd, POLLIN, 0 };
        if (poll(&waiting, 1, 1000) <= 0) {
            continue;
        }
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
        }
    }
}
