// The emulated driver's OpenGL: mapping a texture reads it into memory, unmapping writes it back.
//
// As on a GPU, formats of three channels cannot be registered, and a texture that is mapped is CUDA's alone: its array
// is there only between map and unmap. Flags are kept to: what is read-only is not written back, and what will be
// overwritten is not read but NaN.
#define _GNU_SOURCE
#include <cuda.h>
#include <GL/gl.h>
#include <cudaGL.h>
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RGBA32F 0x8814

// A CUarray: rows of four floats.
struct Image {
    size_t width, height;
    float *texels;
};
struct CUgraphicsResource_st {
    GLuint texture;
    GLenum target;
    unsigned flags;
    int mapped;
    struct Image image;
    CUgraphicsResource next;
};
static CUgraphicsResource registered;  // all of them

// Where a resource hangs in the list; null for what is none. pycuda hands back what a call that failed left undefined.
static CUgraphicsResource *link_of(CUgraphicsResource resource) {
    CUgraphicsResource *at = &registered;
    while (*at && *at != resource) at = &(*at)->next;
    return *at ? at : 0;
}

static void *function(const char *name) {
    static void *library;
    if (!library) library = dlopen("libGL.so.1", RTLD_NOW | RTLD_GLOBAL);
    void *found = library ? dlsym(library, name) : 0;
    if (!found) {
        fprintf(stderr, "emulated driver: found no %s in libGL.so.1\n", name);
        abort();
    }
    return found;
}

// Binds a texture and returns the one that was bound before.
static GLuint bind(GLenum target, GLuint texture) {
    GLint before = 0;
    ((void (*)(GLenum, GLint *))function("glGetIntegerv"))(GL_TEXTURE_BINDING_2D, &before);
    ((void (*)(GLenum, GLuint))function("glBindTexture"))(target, texture);
    return (GLuint)before;
}

CUresult cuGraphicsGLRegisterImage(CUgraphicsResource *resource, GLuint texture, GLenum target, unsigned flags) {
    void (*level)(GLenum, GLint, GLenum, GLint *) = function("glGetTexLevelParameteriv");
    GLint width = 0, height = 0, format = 0;
    if (target != GL_TEXTURE_2D) return CUDA_ERROR_NOT_SUPPORTED;
    if (!((GLboolean(*)(GLuint))function("glIsTexture"))(texture)) return CUDA_ERROR_INVALID_VALUE;
    const GLuint before = bind(target, texture);
    level(target, 0, GL_TEXTURE_WIDTH, &width);
    level(target, 0, GL_TEXTURE_HEIGHT, &height);
    level(target, 0, GL_TEXTURE_INTERNAL_FORMAT, &format);
    bind(target, before);
    if (format != RGBA32F || width <= 0 || height <= 0) return CUDA_ERROR_INVALID_VALUE;
    CUgraphicsResource made = calloc(1, sizeof *made);
    made->texture = texture;
    made->target = target;
    made->flags = flags;
    made->image.width = (size_t)width;
    made->image.height = (size_t)height;
    made->image.texels = malloc((size_t)width * (size_t)height * 16);
    made->next = registered;
    *resource = registered = made;
    return CUDA_SUCCESS;
}

CUresult cuGraphicsMapResources(unsigned count, CUgraphicsResource *resources, CUstream stream) {
    void (*get)(GLenum, GLint, GLenum, GLenum, void *) = function("glGetTexImage");
    for (unsigned i = 0; i < count; ++i) {
        CUgraphicsResource each = resources[i];
        if (!link_of(each)) return CUDA_ERROR_INVALID_HANDLE;
        if (each->mapped) return CUDA_ERROR_ALREADY_MAPPED;
        if (each->flags & CU_GRAPHICS_REGISTER_FLAGS_WRITE_DISCARD) {
            memset(each->image.texels, 0xff, each->image.width * each->image.height * 16);
        } else {
            const GLuint before = bind(each->target, each->texture);
            get(each->target, 0, GL_RGBA, GL_FLOAT, each->image.texels);
            bind(each->target, before);
        }
        each->mapped = 1;
    }
    return CUDA_SUCCESS;
}

CUresult cuGraphicsUnmapResources(unsigned count, CUgraphicsResource *resources, CUstream stream) {
    void (*put)(GLenum, GLint, GLint, GLint, GLsizei, GLsizei, GLenum, GLenum, const void *) =
        function("glTexSubImage2D");
    for (unsigned i = 0; i < count; ++i) {
        CUgraphicsResource each = resources[i];
        if (!each->mapped) return CUDA_ERROR_NOT_MAPPED;
        if (!(each->flags & CU_GRAPHICS_REGISTER_FLAGS_READ_ONLY)) {
            const GLuint before = bind(each->target, each->texture);
            put(each->target, 0, 0, 0, (GLsizei)each->image.width, (GLsizei)each->image.height, GL_RGBA, GL_FLOAT,
                each->image.texels);
            bind(each->target, before);
        }
        each->mapped = 0;
    }
    return CUDA_SUCCESS;
}

CUresult cuGraphicsSubResourceGetMappedArray(CUarray *array, CUgraphicsResource resource, unsigned index,
                                             unsigned level) {
    if (!resource->mapped) return CUDA_ERROR_NOT_MAPPED;
    if (index || level) return CUDA_ERROR_INVALID_VALUE;
    *array = (CUarray)&resource->image;
    return CUDA_SUCCESS;
}
CUresult cuGraphicsUnregisterResource(CUgraphicsResource resource) {
    CUgraphicsResource *link = link_of(resource);
    if (!link) return CUDA_ERROR_INVALID_HANDLE;
    if (resource->mapped) return CUDA_ERROR_ALREADY_MAPPED;
    *link = resource->next;
    free(resource->image.texels);
    free(resource);
    return CUDA_SUCCESS;
}
// Arrays of mapped textures belong to OpenGL.
CUresult cuArrayDestroy(CUarray array) { return CUDA_SUCCESS; }

static char *side(CUmemorytype kind, const void *host, CUdeviceptr device, CUarray array, size_t *pitch) {
    if (kind == CU_MEMORYTYPE_HOST) return (char *)host;
    if (kind == CU_MEMORYTYPE_DEVICE) return (char *)device;
    const struct Image *image = (const struct Image *)array;
    *pitch = 16 * image->width;
    return (char *)image->texels;
}
CUresult cuMemcpy2D_v2(const CUDA_MEMCPY2D *copy) {
    size_t from_pitch = copy->srcPitch, to_pitch = copy->dstPitch;
    const char *from = side(copy->srcMemoryType, copy->srcHost, copy->srcDevice, copy->srcArray, &from_pitch);
    char *to = side(copy->dstMemoryType, copy->dstHost, copy->dstDevice, copy->dstArray, &to_pitch);
    if (copy->WidthInBytes > from_pitch || copy->WidthInBytes > to_pitch) return CUDA_ERROR_INVALID_VALUE;
    for (size_t y = 0; y < copy->Height; ++y)
        memcpy(to + (y + copy->dstY) * to_pitch + copy->dstXInBytes,
               from + (y + copy->srcY) * from_pitch + copy->srcXInBytes, copy->WidthInBytes);
    return CUDA_SUCCESS;
}
CUresult cuMemcpy2DUnaligned_v2(const CUDA_MEMCPY2D *copy) { return cuMemcpy2D_v2(copy); }
CUresult cuMemcpy2DAsync_v2(const CUDA_MEMCPY2D *copy, CUstream stream) { return cuMemcpy2D_v2(copy); }
