/* Random numbers of the soaks. */
static unsigned long long state_of_random;

/* xorshift64*: the same on every machine. */
static double uniform(double low, double high) {
    unsigned long long x = state_of_random;
    x ^= x >> 12;
    x ^= x << 25;
    x ^= x >> 27;
    state_of_random = x;
    return low + (high - low) * (double)((x * 2685821657736338717ULL) >> 11) / 9007199254740992.0;
}
