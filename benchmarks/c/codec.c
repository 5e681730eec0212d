/* ns a frame in the C library: codec COUNT HEX parses that frame, codec COUNT pack packs an
 * RC_CHANNELS_OVERRIDE.  For each byte on stdin one batch of COUNT, and its time on a line of
 * stdout: whoever asks can let it take turns with others. */
#include "common.h"
#include "common/mavlink.h"

static volatile float kept;

/* The fields of a hot frame, all of them, as its reader would have them. */
static void decode(const mavlink_message_t *message)
{
    union {
        mavlink_attitude_quaternion_t attitude;
        mavlink_local_position_ned_t position;
        mavlink_raw_imu_t imu;
        mavlink_servo_output_raw_t servos;
        mavlink_odometry_t odometry;
    } to;
    memset(&to, 0, sizeof to.attitude);
    switch (message->msgid) {
    case MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
        mavlink_msg_attitude_quaternion_decode(message, &to.attitude);
        break;
    case MAVLINK_MSG_ID_LOCAL_POSITION_NED:
        mavlink_msg_local_position_ned_decode(message, &to.position);
        break;
    case MAVLINK_MSG_ID_RAW_IMU:
        mavlink_msg_raw_imu_decode(message, &to.imu);
        break;
    case MAVLINK_MSG_ID_SERVO_OUTPUT_RAW:
        mavlink_msg_servo_output_raw_decode(message, &to.servos);
        break;
    case MAVLINK_MSG_ID_ODOMETRY:
        mavlink_msg_odometry_decode(message, &to.odometry);
        break;
    }
    kept = to.attitude.q1;
}

static size_t bytes_of(const char *hex, uint8_t *to)
{
    size_t size = 0;
    for (unsigned byte; size < MAVLINK_MAX_PACKET_LEN && sscanf(hex + 2 * size, "%2x", &byte) == 1;
         size++) {
        to[size] = byte;
    }
    return size;
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        return 2;
    }
    long count = atol(argv[1]);
    int packs = strcmp(argv[2], "pack") == 0;
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];
    size_t size = packs ? 0 : bytes_of(argv[2], frame);
    mavlink_message_t message;
    mavlink_status_t status;
    while (getchar() != EOF) {
        long parsed = 0;
        int64_t begun = now_ns();
        for (long n = 0; n < count; n++) {
            for (size_t i = 0; i < size; i++) {
                if (mavlink_parse_char(MAVLINK_COMM_0, frame[i], &message, &status)) {
                    decode(&message);
                    parsed++;
                }
            }
            if (packs) {
                mavlink_msg_rc_channels_override_pack(255, 191, &message, 1, 1, 1500 + (n & 255),
                    1501, 1502, 1503, 65535, 65535, 65535, 65535, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
                kept = mavlink_msg_to_send_buffer(frame, &message);
            }
        }
        printf("%.3f\n", (double)(now_ns() - begun) / count);
        fflush(stdout);
        if (!packs && parsed != count) {
            return 1;
        }
    }
    return 0;
}
