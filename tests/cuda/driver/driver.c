// A CUDA driver without a GPU, for tests: libcuda.so.1 over the processor's own memory.
//
// It answers what pycuda asks on the way of prtnet/render/interop.py, with the driver's own rules: a context has to be
// current, grids are not empty, blocks have at most 1024 threads. A module is the image of a shared library of
// kernels that prtnet/export/cuda_host.py built, where a GPU's would be a cubin. Work is done when a call returns, so
// streams are in order by themselves. graphics.c has the part of OpenGL; what neither knows is "not supported".
#define _GNU_SOURCE
#include <cuda.h>
#include <dlfcn.h>
#include <elf.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define VERSION 13000
#define CAPABILITY 90

struct CUctx_st {
    int retained;
};
static struct CUctx_st primary;
static int current;  // how often the context was pushed

#define NEED_CONTEXT \
    if (!current) return CUDA_ERROR_INVALID_CONTEXT

CUresult cuInit(unsigned flags) { return flags ? CUDA_ERROR_INVALID_VALUE : CUDA_SUCCESS; }
CUresult cuDriverGetVersion(int *version) {
    *version = VERSION;
    return CUDA_SUCCESS;
}
CUresult cuGetErrorString(CUresult error, const char **text) {
    *text = error == CUDA_ERROR_NOT_SUPPORTED ? "operation not supported (emulated driver)" : "error (emulated driver)";
    return CUDA_SUCCESS;
}
CUresult cuGetErrorName(CUresult error, const char **text) { return cuGetErrorString(error, text); }

CUresult cuDeviceGetCount(int *count) {
    *count = 1;
    return CUDA_SUCCESS;
}
CUresult cuDeviceGet(CUdevice *device, int ordinal) {
    *device = 0;
    return ordinal ? CUDA_ERROR_INVALID_DEVICE : CUDA_SUCCESS;
}
CUresult cuDeviceGetName(char *name, int length, CUdevice device) {
    snprintf(name, (size_t)length, "emulated");
    return CUDA_SUCCESS;
}
CUresult cuDeviceComputeCapability(int *major, int *minor, CUdevice device) {
    *major = CAPABILITY / 10;
    *minor = CAPABILITY % 10;
    return CUDA_SUCCESS;
}
CUresult cuDeviceGetAttribute(int *value, CUdevice_attribute attribute, CUdevice device) {
    switch (attribute) {
    case CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR: *value = CAPABILITY / 10; break;
    case CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR: *value = CAPABILITY % 10; break;
    default: *value = 1024;
    }
    return CUDA_SUCCESS;
}

CUresult cuDevicePrimaryCtxRetain(CUcontext *context, CUdevice device) {
    ++primary.retained;
    *context = &primary;
    return CUDA_SUCCESS;
}
CUresult cuDevicePrimaryCtxRelease_v2(CUdevice device) {
    if (primary.retained) --primary.retained;
    return CUDA_SUCCESS;
}
CUresult cuCtxPushCurrent_v2(CUcontext context) {
    if (context != &primary || !primary.retained) return CUDA_ERROR_INVALID_CONTEXT;
    ++current;
    return CUDA_SUCCESS;
}
CUresult cuCtxPopCurrent_v2(CUcontext *context) {
    NEED_CONTEXT;
    --current;
    if (context) *context = &primary;
    return CUDA_SUCCESS;
}
CUresult cuCtxGetDevice(CUdevice *device) {
    NEED_CONTEXT;
    *device = 0;
    return CUDA_SUCCESS;
}
CUresult cuCtxGetApiVersion(CUcontext context, unsigned *version) {
    *version = VERSION;
    return CUDA_SUCCESS;
}
CUresult cuCtxDetach(CUcontext context) { return CUDA_SUCCESS; }
CUresult cuCtxSynchronize(void) {
    NEED_CONTEXT;
    return CUDA_SUCCESS;
}

// Memory: new memory is NaN, as it might be.
CUresult cuMemAlloc_v2(CUdeviceptr *at, size_t bytes) {
    NEED_CONTEXT;
    if (!bytes) return CUDA_ERROR_INVALID_VALUE;
    void *made = aligned_alloc(256, (bytes + 255) & ~(size_t)255);
    if (!made) return CUDA_ERROR_OUT_OF_MEMORY;
    memset(made, 0xff, bytes);
    *at = (CUdeviceptr)made;
    return CUDA_SUCCESS;
}
CUresult cuMemFree_v2(CUdeviceptr at) {
    free((void *)at);
    return CUDA_SUCCESS;
}
CUresult cuMemcpyHtoD_v2(CUdeviceptr to, const void *from, size_t bytes) {
    NEED_CONTEXT;
    memcpy((void *)to, from, bytes);
    return CUDA_SUCCESS;
}
CUresult cuMemcpyDtoH_v2(void *to, CUdeviceptr from, size_t bytes) {
    NEED_CONTEXT;
    memcpy(to, (const void *)from, bytes);
    return CUDA_SUCCESS;
}
CUresult cuMemsetD32Async(CUdeviceptr at, unsigned value, size_t count, CUstream stream) {
    NEED_CONTEXT;
    for (size_t i = 0; i < count; ++i) ((unsigned *)at)[i] = value;
    return CUDA_SUCCESS;
}
CUresult cuMemsetD32_v2(CUdeviceptr at, unsigned value, size_t count) { return cuMemsetD32Async(at, value, count, 0); }

// Modules: the image says itself how long it is. Each is loaded under a name of its own, for the loader takes a name
// that it has seen for the library that it has.
CUresult cuModuleLoadDataEx(CUmodule *module, const void *image, unsigned count, CUjit_option *options, void **values) {
    NEED_CONTEXT;
    const Elf64_Ehdr *head = image;
    if (memcmp(head->e_ident, ELFMAG, SELFMAG)) return CUDA_ERROR_INVALID_IMAGE;
    const size_t bytes = head->e_shoff + (size_t)head->e_shnum * head->e_shentsize;
    char path[] = "/tmp/prtnet_kernels_XXXXXX";
    const int file = mkstemp(path);
    if (file < 0) return CUDA_ERROR_OUT_OF_MEMORY;
    const int whole = write(file, image, bytes) == (ssize_t)bytes;
    close(file);
    *module = whole ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : 0;
    unlink(path);
    return *module ? CUDA_SUCCESS : CUDA_ERROR_INVALID_IMAGE;
}
CUresult cuModuleLoadData(CUmodule *module, const void *image) { return cuModuleLoadDataEx(module, image, 0, 0, 0); }
CUresult cuModuleUnload(CUmodule module) {
    dlclose(module);
    return CUDA_SUCCESS;
}
CUresult cuModuleGetFunction(CUfunction *function, CUmodule module, const char *name) {
    char entry[256];
    snprintf(entry, sizeof entry, "%s__on_host", name);
    *function = dlsym(module, entry);
    return *function ? CUDA_SUCCESS : CUDA_ERROR_NOT_FOUND;
}
CUresult cuFuncSetBlockShape(CUfunction function, int x, int y, int z) { return CUDA_SUCCESS; }
CUresult cuFuncGetAttribute(int *value, CUfunction_attribute attribute, CUfunction function) {
    *value = 0;
    return CUDA_SUCCESS;
}
CUresult cuLaunchKernel(CUfunction function, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by,
                        unsigned bz, unsigned shared, CUstream stream, void **parameters, void **extra) {
    NEED_CONTEXT;
    if (!gx || gy != 1 || gz != 1 || !bx || bx > 1024 || by != 1 || bz != 1) return CUDA_ERROR_INVALID_VALUE;
    const void *arguments = parameters ? parameters[0] : 0;
    for (int i = 0; extra && extra[i] != CU_LAUNCH_PARAM_END; i += 2)
        if (extra[i] == CU_LAUNCH_PARAM_BUFFER_POINTER) arguments = extra[i + 1];
    if (!arguments) return CUDA_ERROR_INVALID_VALUE;
    const int wrong = ((int (*)(unsigned, const void *))function)(gx, arguments);
    if (wrong) fprintf(stderr, "emulated driver: a kernel ends with %d, see cuda/host.h\n", wrong);
    return wrong ? CUDA_ERROR_LAUNCH_FAILED : CUDA_SUCCESS;
}

// Events are points in time.
CUresult cuEventCreate(CUevent *event, unsigned flags) {
    NEED_CONTEXT;
    *event = calloc(1, sizeof(struct timespec));
    return CUDA_SUCCESS;
}
CUresult cuEventDestroy_v2(CUevent event) {
    free(event);
    return CUDA_SUCCESS;
}
CUresult cuEventRecord(CUevent event, CUstream stream) {
    NEED_CONTEXT;
    clock_gettime(CLOCK_MONOTONIC, (struct timespec *)event);
    return CUDA_SUCCESS;
}
CUresult cuEventQuery(CUevent event) { return CUDA_SUCCESS; }
CUresult cuEventSynchronize(CUevent event) { return CUDA_SUCCESS; }
// cuda.h gives this one the name that its version has
CUresult cuEventElapsedTime(float *milliseconds, CUevent from, CUevent to) {
    const struct timespec *a = (struct timespec *)from, *b = (struct timespec *)to;
    *milliseconds = (float)(1e3 * (double)(b->tv_sec - a->tv_sec) + 1e-6 * (double)(b->tv_nsec - a->tv_nsec));
    return CUDA_SUCCESS;
}
