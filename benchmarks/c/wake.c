/* How late a C loop wakes: wake COUNT PERIOD_NS BEGIN_NS PRIORITY; lateness [ns] to stdout. */
#include "common.h"

int main(int argc, char **argv)
{
    if (argc != 5) {
        return 2;
    }
    long count = atol(argv[1]);
    int64_t period = atoll(argv[2]), due = atoll(argv[3]);
    int64_t *late = calloc(count, sizeof *late);
    memset(late, 1, count * sizeof *late);
    be_on_time(atoi(argv[4]));
    for (long i = 0; i < count; i++, due += period) {
        sleep_until(due);
        late[i] = now_ns() - due;
    }
    return fwrite(late, sizeof *late, count, stdout) != (size_t)count;
}
