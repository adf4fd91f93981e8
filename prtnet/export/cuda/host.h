// Kernels as functions of the processor, for machines without a GPU: the threads of a block are coroutines.
//
// Blocks run one after the other. A thread runs until it ends or reaches __syncthreads(), then the next one goes on: in
// even blocks from the first thread to the last, in odd ones backwards, so that a barrier that is missing shows
// whichever way the data goes. Shared memory is NaN at the start of each block, and its ends are watched.
// name__on_host(blocks, arguments) gives 0, or what is wrong: 1 threads of a block that do not meet at a barrier,
// 2 writes outside of shared memory, 3 too much shared memory.
#pragma once
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <ucontext.h>

#define __device__
#define __constant__ static const
#define __restrict__ __restrict
#define PRT_KERNEL(name, Arguments, threads)                                                             \
    static void name(const Arguments a);                                                                 \
    extern "C" int name##__on_host(unsigned blocks, const void *arguments) {                             \
        return host::launch(blocks, threads, [](const void *a) { name(*(const Arguments *)a); }, arguments); \
    }                                                                                                    \
    static void name(const Arguments a)
#define PRT_SHARED(type, name, count) type *name = (type *)host::shared(sizeof(type) * (count))

struct float4 {
    float x, y, z, w;
};
struct uint2 {
    unsigned x, y;
};
struct Index {
    unsigned x;
};
static Index threadIdx, blockIdx;

static inline float4 make_float4(float x, float y, float z, float w) { return float4{x, y, z, w}; }
static inline float __uint_as_float(unsigned bits) {
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}
static inline float sinpif(float x) { return float(sin(3.14159265358979323846 * double(x))); }
static inline void sincospif(float x, float *sine, float *cosine) {
    *sine = sinpif(x);
    *cosine = float(cos(3.14159265358979323846 * double(x)));
}
static inline int atomicAdd(int *at, int value) {
    const int before = *at;
    *at += value;
    return before;
}

namespace host {
constexpr unsigned THREADS = 256, STACK = 32 << 10, SHARED = 48 << 10, GUARD = 4 << 10;
static ucontext_t caller, threads[THREADS];
static bool ended[THREADS];
static char stacks[THREADS][STACK];
alignas(16) static unsigned char memory[SHARED + 2 * GUARD];
static size_t used;
static void (*body)(const void *);
static const void *given;

static inline void *shared(size_t bytes) {
    used = bytes;
    return memory + GUARD;
}
static inline void entry() {
    const unsigned own = threadIdx.x;
    body(given);
    ended[own] = true;
}
static inline bool guarded() {
    for (size_t i = 0; i < sizeof memory; ++i)
        if ((i < GUARD || i >= GUARD + used) && memory[i] != 0xff) return false;
    return true;
}
static inline int run_block(unsigned count, bool backwards) {
    for (unsigned t = 0; t < count; ++t) {
        getcontext(&threads[t]);
        threads[t].uc_stack.ss_sp = stacks[t];
        threads[t].uc_stack.ss_size = STACK;
        threads[t].uc_link = &caller;
        makecontext(&threads[t], entry, 0);
        ended[t] = false;
    }
    for (unsigned over = 0; over < count;) {
        over = 0;
        for (unsigned i = 0; i < count; ++i) {
            const unsigned t = backwards ? count - 1 - i : i;
            threadIdx.x = t;
            if (!ended[t]) swapcontext(&caller, &threads[t]);
            over += ended[t];
        }
        // on a GPU a thread that has ended is not waited for, but no kernel here means to end before the others do
        if (over && over < count) return 1;
    }
    return 0;
}
static inline int launch(unsigned blocks, unsigned count, void (*kernel)(const void *), const void *arguments) {
    if (count > THREADS) return 3;
    body = kernel;
    given = arguments;
    for (unsigned b = 0; b < blocks; ++b) {
        blockIdx.x = b;
        used = 0;
        memset(memory, 0xff, sizeof memory);
        if (const int wrong = run_block(count, b % 2)) return wrong;
        if (used > SHARED) return 3;
        if (!guarded()) return 2;
    }
    return 0;
}
}  // namespace host

static inline void __syncthreads() {
    const unsigned own = threadIdx.x;
    swapcontext(&host::threads[own], &host::caller);
    threadIdx.x = own;
}
