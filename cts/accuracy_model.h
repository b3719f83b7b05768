/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes from model files, which are hostile until shown otherwise: a child process reads them. */
#ifndef GNOMON_CTS_ACCURACY_MODEL_H
#define GNOMON_CTS_ACCURACY_MODEL_H

#include "cts/generate.h"

/* What a file may ask for. A child that exceeds the time or the memory is killed, and that is the error. */
#define GN_MODEL_SECONDS 120
#define GN_MODEL_BYTES ((uint64_t)6 << 30)
#define GN_MODEL_MOST_TRIANGLES ((uint64_t)50 * 1000 * 1000)
#define GN_MODEL_MOST_INSTANCES ((uint64_t)1 << 20)
#define GN_MODEL_MOST_FILE ((int64_t)4 << 30)

struct gn_model {
    struct gn_mesh *meshes; /* each with at least one triangle; vertices of one position are one vertex */
    uint32_t mesh_count;
    struct gn_model_instance {
        uint32_t mesh;
        float transform[12]; /* world from object, finite */
    } * instances;
    uint32_t instance_count; /* at least one */
};

/* Whether the name ends like a file this reads: .obj, .ply, .gltf, .glb, .stl (in any case). */
bool gn_model_is_file_name(const char *name);

/*
 * Reads a file. All memory is the arena's. False with a message that names the file and, where the reader
 * can tell, the line, byte, mesh or vertex: for a file that is missing, of an unknown kind, malformed,
 * without triangles, with a coordinate that is not finite, with more than the limits above, and for one on
 * which the reading library crashes or hangs. `seconds` 0: GN_MODEL_SECONDS.
 *
 * Call it before threads are started: it forks without exec.
 */
bool gn_model_read(const char *path, double seconds, struct gn_arena *arena, struct gn_model *out,
                   char *out_error, size_t error_size);

/* Whether tracing can be compared there: Embree sees nothing beyond, and a model in one point has no size to stand back by. */
bool gn_model_size_check(const char *path, const double low[3], const double high[3], char *out_error, size_t error_size);

/*
 * The child's part (accuracy_model_child.c): reads the file and writes the meshes to the descriptor. `stage`
 * is memory that the parent sees too: what is being done, for the message after a crash. Does not return.
 *
 * What is written: struct gn_model_header; then either the text of the error, or the meshes, each with its
 * struct gn_model_mesh, positions (3 floats each) and triangles (3 uint32_t each), then the instances.
 */
_Noreturn void gn_model_child(const char *path, int fd, char *stage, size_t stage_size);

#define GN_MODEL_MAGIC UINT32_C(0x474e4d31)
struct gn_model_header {
    uint32_t magic;
    uint32_t error_length; /* not 0: an error, of so many characters */
    uint32_t mesh_count;
    uint32_t instance_count;
};
struct gn_model_mesh {
    uint32_t position_count;
    uint32_t triangle_count;
};

/*
 * What the library does not say (accuracy_model_check.c): the line or byte at which a text is not what its
 * format asks for, and counts that the file cannot hold. True when nothing is wrong as far as this looks;
 * otherwise false with the place and the reason. `data` is the whole file.
 */
bool gn_model_check(const char *path, const char *data, size_t length, char *out_error, size_t error_size);

/*
 * The library's own message with a place, where it tells none: the line of the text that it quotes, or else the whole
 * file, by its size.
 */
void gn_model_locate(const char *message, const char *data, size_t length, char *out, size_t size);

#endif
