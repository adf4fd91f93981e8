// Pixels to packed points, radiance of these points, and points to a picture; stands behind transfer.cu.
//
// Images are (pixels, 4) in float32, in whatever order OpenGL has them. The sums are those of
// prtnet/render/material.py.

struct Pack {
    const float4 *positions;  // of pixels; w: v in the atlas, above 0, where a surface is
    const float4 *normals;
    const float4 *albedo;     // w: u in the atlas
    int *points;              // 0 before; the number of covered pixels after
    int *pixel;               // (points), in no fixed order: nothing depends on it
    float *packed_positions;  // (points, 3)
    float *packed_normals;
    float *packed_uv;         // (points, 2); null: nobody asks for it
    int pixels;
};

PRT_KERNEL(prt_pack, Pack, PRT_PACK_THREADS) {
    PRT_SHARED(int, found, 2);  // covered pixels of the block, and where they start among all
    if (threadIdx.x == 0) found[0] = 0;
    __syncthreads();
    const int pixel = blockIdx.x * PRT_PACK_THREADS + threadIdx.x;
    const bool covered = pixel < a.pixels && a.positions[pixel].w > 0.0f;
    const int place = covered ? atomicAdd(found, 1) : 0;
    __syncthreads();
    if (threadIdx.x == 0) found[1] = atomicAdd(a.points, found[0]);
    __syncthreads();
    if (!covered) return;
    const int point = found[1] + place;
    const float4 position = a.positions[pixel], normal = a.normals[pixel];
    a.pixel[point] = pixel;
    a.packed_positions[3 * point] = position.x;
    a.packed_positions[3 * point + 1] = position.y;
    a.packed_positions[3 * point + 2] = position.z;
    a.packed_normals[3 * point] = normal.x;
    a.packed_normals[3 * point + 1] = normal.y;
    a.packed_normals[3 * point + 2] = normal.z;
    if (!a.packed_uv) return;
    a.packed_uv[2 * point] = a.albedo[pixel].w;
    a.packed_uv[2 * point + 1] = position.w;
}

struct Diffuse {
    const float *transfer;      // (points, PRT_OUTPUTS)
    const int *points;
    const int *pixel;
    const float4 *albedo;       // of pixels
    const float4 *reflectance;  // of pixels: specular RGB and the diffuse weight; null: `weight` everywhere
    const float4 *light;        // SH coefficients, RGB
    float4 *radiance;           // (points)
    int coefficients;           // of the light, at most PRT_COUNT
    float weight;
};

// diffuse albedo / pi sum_i t_i L_i; of four groups those after the first are for red, green and blue.
PRT_KERNEL(prt_diffuse, Diffuse, PRT_SHADE_THREADS) {
    const int point = blockIdx.x * PRT_SHADE_THREADS + threadIdx.x;
    if (point >= *a.points) return;
    constexpr int GREEN = PRT_GROUPS == 4 ? PRT_COUNT : 0;
    const float *transfer = a.transfer + size_t(point) * PRT_OUTPUTS + GREEN;
    float red = 0.0f, green = 0.0f, blue = 0.0f;
    for (int i = 0; i < a.coefficients; ++i) {
        const float4 light = a.light[i];
        red = fmaf(transfer[i], light.x, red);
        green = fmaf(transfer[i + GREEN], light.y, green);
        blue = fmaf(transfer[i + 2 * GREEN], light.z, blue);
    }
    const int pixel = a.pixel[point];
    const float weight = 0.318309886f * (a.reflectance ? a.reflectance[pixel].w : a.weight);
    const float4 albedo = a.albedo[pixel];
    a.radiance[point] = make_float4(weight * albedo.x * red, weight * albedo.y * green, weight * albedo.z * blue, 1.0f);
}

struct Gloss {
    const float *transfer;
    const int *points;
    const int *pixel;
    const float4 *positions;    // of pixels
    const float4 *normals;      // of pixels; w is the exponent where there is a reflectance
    const float4 *reflectance;  // as in Diffuse; null: `specular` and `exponent` everywhere
    const float4 *matrix;       // (PRT_COUNT, PRT_RADIANCE): M_ik of the fixed light, RGB
    float4 *radiance;           // added to
    float eye[3];
    float specular[3];
    float exponent;
};

// specular sum_k s_l(k) H_k Y_k(r), H = M^T t, r the direction to the eye mirrored at the normal.
PRT_KERNEL(prt_gloss, Gloss, PRT_SHADE_THREADS) {
    PRT_SHARED(float, lobes, PRT_RADIANCE * PRT_SHADE_THREADS);  // each thread has a column to itself
    const int point = blockIdx.x * PRT_SHADE_THREADS + threadIdx.x;
    if (point >= *a.points) return;
    float *lobe = lobes + threadIdx.x;
    const int pixel = a.pixel[point];
    const float4 position = a.positions[pixel], normal = a.normals[pixel];
    const float x = position.x - a.eye[0], y = position.y - a.eye[1], z = position.z - a.eye[2];
    const float twice = 2.0f * (x * normal.x + y * normal.y + z * normal.z), size = 1.0f / sqrtf(x * x + y * y + z * z);
    harmonics(size * (x - twice * normal.x), size * (y - twice * normal.y), size * (z - twice * normal.z),
              PRT_RADIANCE_BANDS, [&](int k, int, float value) { lobe[k * PRT_SHADE_THREADS] = value; });
    // s_l = s_{l-2} (e - l + 2) / (e + l + 1), as sh.phong_lobe finds them
    const float exponent = a.reflectance ? normal.w : a.exponent;
    float zonal = 1.0f, before = 1.0f;  // s_0, and what makes s_1 (e + 1) / (e + 2)
    for (int l = 0; l < PRT_RADIANCE_BANDS; ++l) {
        for (int k = l * l; k < (l + 1) * (l + 1); ++k) lobe[k * PRT_SHADE_THREADS] *= zonal;
        const float next = before * (exponent - l + 1.0f) / (exponent + l + 2.0f);
        before = zonal;
        zonal = next;
    }
    const float *transfer = a.transfer + size_t(point) * PRT_OUTPUTS;
    float red = 0.0f, green = 0.0f, blue = 0.0f;
#pragma unroll 1
    for (int i = 0; i < PRT_COUNT; ++i) {
        float r = 0.0f, g = 0.0f, b = 0.0f;
#pragma unroll 4
        for (int k = 0; k < PRT_RADIANCE; ++k) {
            const float4 entry = a.matrix[i * PRT_RADIANCE + k];
            const float value = lobe[k * PRT_SHADE_THREADS];
            r = fmaf(entry.x, value, r);
            g = fmaf(entry.y, value, g);
            b = fmaf(entry.z, value, b);
        }
        red = fmaf(transfer[i], r, red);
        green = fmaf(transfer[i], g, green);
        blue = fmaf(transfer[i], b, blue);
    }
    float4 own = make_float4(a.specular[0], a.specular[1], a.specular[2], 0.0f);
    if (a.reflectance) own = a.reflectance[pixel];
    float4 radiance = a.radiance[point];
    radiance.x += own.x * red;
    radiance.y += own.y * green;
    radiance.z += own.z * blue;
    a.radiance[point] = radiance;
}

struct Unpack {
    const float4 *radiance;  // (points)
    const int *points;
    const int *pixel;
    float4 *picture;  // of pixels; those that show nothing stay as they are
};

PRT_KERNEL(prt_unpack, Unpack, PRT_PACK_THREADS) {
    const int point = blockIdx.x * PRT_PACK_THREADS + threadIdx.x;
    if (point < *a.points) a.picture[a.pixel[point]] = a.radiance[point];
}
