/* How late a C loop wakes: wake COUNT PERIOD_NS BEGIN_NS PRIORITY AWAKE_NS; lateness [ns] to stdout.
 * The last AWAKE_NS before each deadline it does not sleep: 0 is cyclictest's loop. */
#include "common.h"

int main(int argc, char **argv)
{
    if (argc != 6) {
        return 2;
    }
    long count = atol(argv[1]);
    int64_t period = atoll(argv[2]), due = atoll(argv[3]), awake = atoll(argv[5]);
    int64_t *late = calloc(count, sizeof *late);
    memset(late, 1, count * sizeof *late);
    be_on_time(atoi(argv[4]));
    for (long i = 0; i < count; i++, due += period) {
        int64_t now;
        sleep_until(due - awake);
        while ((now = now_ns()) < due) {
        }
        late[i] = now - due;
    }
    return fwrite(late, sizeof *late, count, stdout) != (size_t)count;
}
