// Transfer of packed points by a net; shading.cu follows in the same text.
//
// One source for nvcc, NVRTC and, through host.h, a plain C++ compiler. Everything that follows from the net is a macro
// that prtnet/export/cuda.py writes (`defines`), so all loops have known bounds. Kernels are
//
//     PRT_KERNEL(name, Arguments, threads a block) { ... }     with `a`, the arguments, as one structure
//
// Sizes: PRT_TILE points a block of prt_transfer, PRT_THREADS threads, PRT_ROWS the widest layer or the inputs,
// PRT_COUNT coefficients of a group, PRT_GROUPS groups. The buffer of parameters is described in cuda.py.
#ifdef PRT_HOST
#include "host.h"
#else
#define PRT_KERNEL(name, Arguments, threads) \
    extern "C" __global__ void __launch_bounds__(threads) name(const Arguments a)
#define PRT_SHARED(type, name, count) __shared__ __align__(16) type name[count]
#endif

#define PRT_OUTPUTS (PRT_GROUPS * PRT_COUNT)
// Floats from row to row of a tile. The four are empty: with them, neighbouring rows of a point are in different banks.
#define PRT_PITCH (PRT_TILE + 4)

// Spherical harmonics by the recurrences of prtnet/sh.py, whose constants depend on l and m alone.
__constant__ float prt_diagonal[] = PRT_DIAGONAL;
__constant__ float prt_ahead[] = PRT_AHEAD;    // of (l, m) at l * PRT_TABLE_BANDS + m
__constant__ float prt_behind[] = PRT_BEHIND;
__constant__ float prt_cosine[] = PRT_COSINE;  // zonal coefficients of max(0, cos)

// put(index, band, Y_index(direction)) for all coefficients of `bands` bands; the direction is a unit vector.
template <class Put>
__device__ inline void harmonics(float x, float y, float z, int bands, Put put) {
    float cosine = 1.0f, sine = 0.0f;
    for (int m = 0; m < bands; ++m) {
        if (m > 0) {
            const float turned = x * cosine - y * sine;
            sine = x * sine + y * cosine;
            cosine = turned;
        }
        float before = 0.0f, legendre = prt_diagonal[m];
        for (int l = m; l < bands; ++l) {
            if (l > m) {
                const int at = l * PRT_TABLE_BANDS + m;
                const float next = prt_ahead[at] * z * legendre - prt_behind[at] * before;
                before = legendre;
                legendre = next;
            }
            put(l * l + l + m, l, legendre * cosine);
            if (m > 0) put(l * l + l - m, l, legendre * sine);
        }
    }
}

// ------------------------------------------------------------------------------------------------ the net's inputs

// sin and cos of 2 pi `turns`, or the triangle waves with their zeros and peaks; turns in [-1/2, 1/2].
__device__ inline void waves(float turns, float &sine, float &cosine) {
#ifdef PRT_TRIANGLE
    const float from_peak = turns - 0.25f;
    sine = 1.0f - 4.0f * fabsf(from_peak - floorf(from_peak + 0.5f));
    cosine = 1.0f - 4.0f * fabsf(turns);
#else
    sincospif(2.0f * turns, &sine, &cosine);
#endif
}

// gamma of component `axis` of a vector into the rows from `first` on, for one point of the tile.
__device__ inline void encode(float value, int axis, int first, int frequencies, float *column) {
    column[(first + axis) * PRT_PITCH] = value;
    float octave = 0.5f;
    for (int j = 0; j < frequencies; ++j, octave *= 2.0f) {
        // whole turns go first: what is left is exact in float32 at any frequency
        float turns = octave * value, sine, cosine;
        turns -= floorf(turns + 0.5f);
        waves(turns, sine, cosine);
        const int row = first + 3 + 6 * j + axis;
        column[row * PRT_PITCH] = sine;
        column[(row + 3) * PRT_PITCH] = cosine;
    }
}

// A finite float16 in the low bits: its exponent is 112 below that of float32, denormals included.
__device__ inline float from_half(unsigned bits) {
    const float magnitude = __uint_as_float((bits & 0x7fffu) << 13) * 5.192296858534828e33f;
    return bits & 0x8000u ? -magnitude : magnitude;
}

// Four channels of a table, in float16 or float32.
template <bool HALF>
__device__ inline float4 texel(const float *__restrict__ table, unsigned quad) {
    if (!HALF) return reinterpret_cast<const float4 *>(table)[quad];
    const uint2 pair = reinterpret_cast<const uint2 *>(table)[quad];
    return make_float4(from_half(pair.x), from_half(pair.x >> 16), from_half(pair.y), from_half(pair.y >> 16));
}

__device__ inline void add(float4 &sum, float weight, float4 value) {
    sum.x += weight * value.x;
    sum.y += weight * value.y;
    sum.z += weight * value.z;
    sum.w += weight * value.w;
}

__device__ inline void store(float *column, int row, float4 value) {
    column[row * PRT_PITCH] = value.x;
    column[(row + 1) * PRT_PITCH] = value.y;
    column[(row + 2) * PRT_PITCH] = value.z;
    column[(row + 3) * PRT_PITCH] = value.w;
}

// Where a coordinate lies among SIZE values at the middle of cells over [-1, 1], held at the first and the last. Cells
// count from the middle one: there float32 has the most digits to say where in a cell a point is.
template <int SIZE>
__device__ inline void place(float coordinate, int &low, int &high, float &share) {
    constexpr int middle = SIZE / 2;
    float at = fmaf(0.5f * SIZE, coordinate, (SIZE % 2) / 2.0f - 0.5f);
    at = fminf(fmaxf(at, -float(middle)), float(SIZE - 1 - middle));
    low = int(floorf(at)) + middle;
    high = low + 1 < SIZE ? low + 1 : SIZE - 1;
    share = at - floorf(at);
}

// Trilinear features of a dense grid, stored (z, y, x, channels), into rows from ROW on.
template <int ROW, int X, int Y, int Z, int CHANNELS, bool HALF>
__device__ inline void dense_grid(const float *__restrict__ table, float *tile) {
    for (int job = threadIdx.x; job < CHANNELS / 4 * PRT_TILE; job += PRT_THREADS) {
        float *column = tile + job % PRT_TILE;
        const int quad = job / PRT_TILE;
        int x[2], y[2], z[2];
        float u, v, w;
        place<X>(column[0], x[0], x[1], u);
        place<Y>(column[PRT_PITCH], y[0], y[1], v);
        place<Z>(column[2 * PRT_PITCH], z[0], z[1], w);
        float4 sum = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
#pragma unroll
        for (int corner = 0; corner < 8; ++corner) {
            const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
            const float weight = (i ? u : 1.0f - u) * (j ? v : 1.0f - v) * (k ? w : 1.0f - w);
            const unsigned cell = (unsigned(z[k]) * Y + y[j]) * X + x[i];
            add(sum, weight, texel<HALF>(table, cell * (CHANNELS / 4) + quad));
        }
        store(column, ROW + 4 * quad, sum);
    }
}

// Features of a hashed grid of CELLS along each axis; corners share ENTRIES (Müller et al. 2022, equation 4).
template <int ROW, int CELLS, int ENTRIES, int CHANNELS, bool HALF>
__device__ inline void hashed_grid(const float *__restrict__ table, float *tile) {
    for (int job = threadIdx.x; job < CHANNELS / 4 * PRT_TILE; job += PRT_THREADS) {
        float *column = tile + job % PRT_TILE;
        const int quad = job / PRT_TILE;
        const float at_x = 0.5f * CELLS * column[0];
        const float at_y = 0.5f * CELLS * column[PRT_PITCH];
        const float at_z = 0.5f * CELLS * column[2 * PRT_PITCH];
        const float x = floorf(at_x), y = floorf(at_y), z = floorf(at_z);
        const float u = at_x - x, v = at_y - y, w = at_z - z;
        float4 sum = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
#pragma unroll
        for (int corner = 0; corner < 8; ++corner) {
            const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
            const float weight = (i ? u : 1.0f - u) * (j ? v : 1.0f - v) * (k ? w : 1.0f - w);
            const unsigned mixed =
                unsigned(int(x) + i) ^ unsigned(int(y) + j) * 2654435761u ^ unsigned(int(z) + k) * 805459861u;
            add(sum, weight, texel<HALF>(table, (mixed & (ENTRIES - 1u)) * (CHANNELS / 4) + quad));
        }
        store(column, ROW + 4 * quad, sum);
    }
}

// Where a texture coordinate lies among SIZE texels, which go on beyond the first and the last. The whole texels come
// off before anything is rounded: the share keeps its digits however large the image is.
template <int SIZE>
__device__ inline void place_texel(float coordinate, int &low, int &high, float &share) {
    coordinate = fminf(fmaxf(coordinate, 0.0f), 1.0f);
    const float whole = floorf(float(SIZE) * coordinate);
    const float rest = fmaf(float(SIZE), coordinate, -whole) - 0.5f;
    const int before = int(whole) + int(floorf(rest));
    low = before < 0 ? 0 : before;
    high = before + 1 < SIZE ? before + 1 : SIZE - 1;
    share = rest - floorf(rest);
}

// Bilinear features of an image over the atlas, stored (y, x, channels) from v = 1 downwards, at `uv` of the points from
// `first` on, into rows from ROW on.
template <int ROW, int X, int Y, int CHANNELS, bool HALF>
__device__ inline void texel_image(
    const float *__restrict__ table, const float *__restrict__ uv, int first, int points, float *tile) {
    for (int job = threadIdx.x; job < CHANNELS / 4 * PRT_TILE; job += PRT_THREADS) {
        const int q = job % PRT_TILE, quad = job / PRT_TILE, point = first + q < points ? first + q : first;
        int x[2], y[2];
        float u, v;
        place_texel<X>(uv[2 * point], x[0], x[1], u);
        place_texel<Y>(uv[2 * point + 1], y[0], y[1], v);
        float4 sum = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
#pragma unroll
        for (int corner = 0; corner < 4; ++corner) {
            const int i = corner & 1, j = corner >> 1;
            const float weight = (i ? u : 1.0f - u) * (j ? v : 1.0f - v);
            const unsigned cell = unsigned(Y - 1 - y[j]) * X + x[i];
            add(sum, weight, texel<HALF>(table, cell * (CHANNELS / 4) + quad));
        }
        store(tile + q, ROW + 4 * quad, sum);
    }
}

// ------------------------------------------------------------------------------------------------------- the layers

// The activations of netspec.activation; x / (1 + exp(-x)) with exp kept finite.
__device__ inline float bend(float x) {
#if defined(PRT_LEAKY_RELU)
    return fmaxf(x, PRT_NEGATIVE_SLOPE * x);
#elif defined(PRT_RELU)
    return fmaxf(x, 0.0f);
#elif defined(PRT_HARD_GELU)
    return x * fminf(fmaxf(0.5f + 0.5f * x, 0.0f), 1.0f);
#elif defined(PRT_SINE)
    // whole turns go in two parts, the first of 8 bits, whose multiples float32 holds exactly
    const float turns = rintf(0.159154943f * x);
    const float rest = fmaf(turns, -1.93530718e-3f, fmaf(turns, -6.28125f, x));
    return sinpif(0.318309886f * rest);
#elif defined(PRT_SILU)
    return x / (1.0f + expf(fminf(-x, 80.0f)));
#elif defined(PRT_GELU)
    return x / (1.0f + expf(fminf(-x * (1.59576912f + 0.0713548163f * x * x), 80.0f)));
#endif
}

template <bool LAST>
__device__ inline float finish(float x) {
    if (!LAST) return bend(x);
#ifdef PRT_TANH
    x = tanhf(x);
#endif
    return PRT_OUTPUT_SCALE * x;
}

__device__ inline void multiply(float (&sums)[4][4], float4 w, float4 x) {
    const float rows[4] = {w.x, w.y, w.z, w.w}, points[4] = {x.x, x.y, x.z, x.w};
#pragma unroll
    for (int o = 0; o < 4; ++o)
#pragma unroll
        for (int q = 0; q < 4; ++q) sums[o][q] = fmaf(rows[o], points[q], sums[o][q]);
}

// One layer, in place: rows of the tile in, rows of the tile out. A thread has four points and, SHARE times, four
// neighbouring outputs in registers. `weights` is (inputs, outputs), outputs padded to a multiple of four.
template <int INPUTS, int OUTPUTS, bool LAST>
__device__ inline void layer(const float *__restrict__ weights, const float *__restrict__ biases, float *tile) {
    constexpr int COLUMNS = PRT_TILE / 4, TEAMS = PRT_THREADS / COLUMNS;
    constexpr int QUADS = (OUTPUTS + 3) / 4, SHARE = (QUADS + TEAMS - 1) / TEAMS;
    const int column = 4 * (threadIdx.x % COLUMNS), team = threadIdx.x / COLUMNS;
    float sums[SHARE][4][4];
#pragma unroll
    for (int r = 0; r < SHARE; ++r)
#pragma unroll
        for (int o = 0; o < 4; ++o)
#pragma unroll
            for (int q = 0; q < 4; ++q)
                sums[r][o][q] = team + r * TEAMS < QUADS ? biases[4 * (team + r * TEAMS) + o] : 0.0f;
#pragma unroll 2
    for (int i = 0; i < INPUTS; ++i) {
        const float4 x = *reinterpret_cast<const float4 *>(tile + i * PRT_PITCH + column);
#pragma unroll
        for (int r = 0; r < SHARE; ++r)
            if (team + r * TEAMS < QUADS)
                multiply(sums[r], reinterpret_cast<const float4 *>(weights)[i * QUADS + team + r * TEAMS], x);
    }
    __syncthreads();  // all have read before any writes
#pragma unroll
    for (int r = 0; r < SHARE; ++r)
#pragma unroll
        for (int o = 0; o < 4; ++o) {
            const int row = 4 * (team + r * TEAMS) + o;
            if (row < OUTPUTS)
#pragma unroll
                for (int q = 0; q < 4; ++q) tile[row * PRT_PITCH + column + q] = finish<LAST>(sums[r][o][q]);
        }
    __syncthreads();
}

struct Transfer {
    const float *parameters;  // of the net
    const float *positions;   // (points, 3), centred, in [-1, 1]^3
    const float *normals;     // (points, 3), unit
    const float *uv;          // (points, 2), in the atlas, v up; null where the net has no texels
    const int *points;        // how many there are: known on the device alone
    float *transfer;          // (points, PRT_OUTPUTS)
};

PRT_KERNEL(prt_transfer, Transfer, PRT_THREADS) {
    PRT_SHARED(float, tile, PRT_ROWS * PRT_PITCH);
    const int first = blockIdx.x * PRT_TILE, points = *a.points;
    if (first >= points) return;
    for (int job = threadIdx.x; job < 6 * PRT_TILE; job += PRT_THREADS) {
        const int q = job % PRT_TILE, axis = job / PRT_TILE, point = first + q;
        const bool is_normal = axis >= 3;
        const float *from = is_normal ? a.normals : a.positions;
        // what fills up the last tile is finite, and never written
        const float value = point < points ? from[3 * point + axis % 3] : 0.0f;
        encode(value, axis % 3, is_normal ? 3 + 6 * PRT_POSITION_FREQUENCIES : 0,
               is_normal ? PRT_NORMAL_FREQUENCIES : PRT_POSITION_FREQUENCIES, tile + q);
    }
    __syncthreads();
#define PRT_GRID(row, x, y, z, channels, half, offset) \
    dense_grid<row, x, y, z, channels, half>(a.parameters + offset, tile);
#define PRT_HASH(row, cells, entries, channels, half, offset) \
    hashed_grid<row, cells, entries, channels, half>(a.parameters + offset, tile);
#define PRT_TEXEL(row, x, y, channels, half, offset) \
    texel_image<row, x, y, channels, half>(a.parameters + offset, a.uv, first, points, tile);
#define PRT_LAYER(inputs, outputs, last, weights, biases) \
    layer<inputs, outputs, last>(a.parameters + weights, a.parameters + biases, tile);
    PRT_GRIDS(PRT_GRID)
    PRT_HASHES(PRT_HASH)
    PRT_TEXELS(PRT_TEXEL)
    __syncthreads();
    PRT_LAYERS(PRT_LAYER)
#ifdef PRT_RESIDUAL
    for (int q = threadIdx.x; q < PRT_TILE && first + q < points; q += PRT_THREADS) {
        const float *normal = a.normals + 3 * (first + q);
        harmonics(normal[0], normal[1], normal[2], PRT_BANDS, [&](int i, int l, float value) {
            for (int group = 0; group < PRT_GROUPS; ++group)
                tile[(group * PRT_COUNT + i) * PRT_PITCH + q] += prt_cosine[l] * value;
        });
    }
    __syncthreads();
#endif
    for (int job = threadIdx.x; job < PRT_OUTPUTS * PRT_TILE; job += PRT_THREADS) {
        const int q = job / PRT_OUTPUTS, row = job % PRT_OUTPUTS;
        if (first + q < points) a.transfer[size_t(first + q) * PRT_OUTPUTS + row] = tile[row * PRT_PITCH + q];
    }
}
