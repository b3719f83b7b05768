/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes of known shape. Rays and transforms are in generate_rays.c. */
#include "cts/generate.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

static double f32(double x)
{
    return (double)(float)x;
}

static struct gn_mesh mesh_alloc(struct gn_arena *arena, uint32_t positions, uint32_t triangles)
{
    struct gn_mesh mesh = {0};
    mesh.positions = gn_arena_alloc(arena, positions, sizeof *mesh.positions);
    mesh.position_count = positions;
    mesh.triangles = gn_arena_alloc(arena, triangles, sizeof *mesh.triangles);
    mesh.triangle_count = triangles;
    return mesh;
}

static void position_set(struct gn_mesh *mesh, uint32_t index, double x, double y, double z)
{
    mesh->positions[index][0] = f32(x);
    mesh->positions[index][1] = f32(y);
    mesh->positions[index][2] = f32(z);
}

static void triangle_set(struct gn_mesh *mesh, uint32_t index, uint32_t a, uint32_t b, uint32_t c)
{
    mesh->triangles[index][0] = a;
    mesh->triangles[index][1] = b;
    mesh->triangles[index][2] = c;
}

/* Two triangles for a cell with these corners, counter-clockwise from the lower left; gives the next index. */
static uint32_t cell_set(struct gn_mesh *mesh, uint32_t index, const uint32_t corner[4], bool other_diagonal)
{
    if (other_diagonal) {
        triangle_set(mesh, index, corner[0], corner[1], corner[3]);
        triangle_set(mesh, index + 1, corner[1], corner[2], corner[3]);
    } else {
        triangle_set(mesh, index, corner[0], corner[1], corner[2]);
        triangle_set(mesh, index + 1, corner[0], corner[2], corner[3]);
    }
    return index + 2;
}

/* Cells of a grid of columns x rows whose vertices start at `base`, row by row. */
static uint32_t grid_cells(struct gn_mesh *mesh, uint32_t index, uint32_t base, uint32_t columns, uint32_t rows,
                           struct gn_random *random)
{
    uint32_t stride = columns + 1;
    for (uint32_t j = 0; j < rows; j++) {
        for (uint32_t i = 0; i < columns; i++) {
            uint32_t v = base + j * stride + i;
            uint32_t corner[4] = {v, v + 1, v + stride + 1, v + stride};
            index = cell_set(mesh, index, corner, random && gn_random_below(random, 2));
        }
    }
    return index;
}

struct gn_mesh gn_mesh_height_field(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude)
{
    struct gn_mesh mesh = mesh_alloc(arena, (n + 1) * (n + 1), 2 * n * n);
    for (uint32_t j = 0; j <= n; j++)
        for (uint32_t i = 0; i <= n; i++)
            position_set(&mesh, j * (n + 1) + i, 2.0 * i / n - 1, 2.0 * j / n - 1,
                         gn_random_range(random, -amplitude, amplitude));
    grid_cells(&mesh, 0, 0, n, n, random);
    return mesh;
}

static double lattice_height(struct gn_random *random, double amplitude)
{
    return amplitude / 256 * ((double)gn_random_below(random, 513) - 256);
}

struct gn_mesh gn_mesh_lattice(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude)
{
    struct gn_mesh mesh = mesh_alloc(arena, (n + 1) * (n + 1), 2 * n * n);
    for (uint32_t j = 0; j <= n; j++)
        for (uint32_t i = 0; i <= n; i++)
            position_set(&mesh, j * (n + 1) + i, 2.0 * i / n - 1, 2.0 * j / n - 1,
                         lattice_height(random, amplitude));
    grid_cells(&mesh, 0, 0, n, n, random);
    return mesh;
}

struct gn_mesh gn_mesh_blob(struct gn_arena *arena, struct gn_random *random, uint32_t rings, uint32_t sectors,
                            double bumps)
{
    struct gn_mesh mesh = mesh_alloc(arena, rings * sectors + 2, 2 * rings * sectors);
    uint32_t north = rings * sectors, south = north + 1, t = 0;
    for (uint32_t r = 0; r < rings; r++) {
        double latitude = PI * ((r + 1.0) / (rings + 1.0) - 0.5);
        for (uint32_t s = 0; s < sectors; s++) {
            double longitude = 2 * PI * s / sectors;
            double radius = 1 + gn_random_range(random, -bumps, bumps);
            position_set(&mesh, r * sectors + s, radius * cos(latitude) * cos(longitude),
                         radius * cos(latitude) * sin(longitude), radius * sin(latitude));
        }
    }
    position_set(&mesh, north, 0, 0, 1 + gn_random_range(random, -bumps, bumps));
    position_set(&mesh, south, 0, 0, -1 + gn_random_range(random, -bumps, bumps));
    for (uint32_t s = 0; s < sectors; s++) {
        uint32_t next = (s + 1) % sectors, top = (rings - 1) * sectors;
        triangle_set(&mesh, t++, south, next, s);
        for (uint32_t r = 0; r + 1 < rings; r++) {
            uint32_t low = r * sectors, high = low + sectors;
            uint32_t corner[4] = {low + s, low + next, high + next, high + s};
            t = cell_set(&mesh, t, corner, gn_random_below(random, 2));
        }
        triangle_set(&mesh, t++, north, top + s, top + next);
    }
    return mesh;
}

struct gn_mesh gn_mesh_torus(struct gn_arena *arena, uint32_t rings, uint32_t sectors, double minor)
{
    struct gn_mesh mesh = mesh_alloc(arena, rings * sectors, 2 * rings * sectors);
    uint32_t t = 0;
    for (uint32_t r = 0; r < rings; r++) {
        double around = 2 * PI * r / rings;
        for (uint32_t s = 0; s < sectors; s++) {
            double across = 2 * PI * s / sectors, radius = 1 + minor * cos(across);
            position_set(&mesh, r * sectors + s, radius * cos(around), radius * sin(around), minor * sin(across));
        }
    }
    for (uint32_t r = 0; r < rings; r++) {
        for (uint32_t s = 0; s < sectors; s++) {
            uint32_t r1 = (r + 1) % rings, s1 = (s + 1) % sectors;
            uint32_t corner[4] = {r * sectors + s, r1 * sectors + s, r1 * sectors + s1, r * sectors + s1};
            t = cell_set(&mesh, t, corner, (r + s) & 1);
        }
    }
    return mesh;
}

/* Merges vertices with equal positions, so that faces made one by one share their seams: a table over the
 * lattice of spacing 1/n in [-1,1]^3, on which all of them lie, tells where each first occurred. */
static void lattice_weld(struct gn_arena *arena, struct gn_mesh *mesh, uint32_t n)
{
    size_t side = 2 * (size_t)n + 1;
    uint32_t *first = gn_arena_alloc(arena, side * side * side, sizeof *first);
    uint32_t *map = gn_arena_alloc(arena, mesh->position_count, sizeof *map);
    uint32_t kept = 0;
    for (uint32_t v = 0; v < mesh->position_count; v++) {
        size_t slot = 0;
        for (int c = 0; c < 3; c++)
            slot = slot * side + (size_t)((mesh->positions[v][c] + 1) * n);
        if (!first[slot]) {
            memmove(mesh->positions[kept], mesh->positions[v], sizeof *mesh->positions);
            first[slot] = ++kept;
        }
        map[v] = first[slot] - 1;
    }
    mesh->position_count = kept;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            mesh->triangles[t][c] = map[mesh->triangles[t][c]];
}

struct gn_mesh gn_mesh_box(struct gn_arena *arena, uint32_t n)
{
    uint32_t per_face = (n + 1) * (n + 1), t = 0;
    struct gn_mesh mesh = mesh_alloc(arena, 6 * per_face, 12 * n * n);
    for (uint32_t face = 0; face < 6; face++) {
        /* u x v is the outward normal: axis, swapped on the negative side. */
        uint32_t axis = face / 2, negative = face % 2;
        uint32_t u = (axis + 1 + negative) % 3, v = (axis + 2 - negative) % 3;
        for (uint32_t j = 0; j <= n; j++) {
            for (uint32_t i = 0; i <= n; i++) {
                double *p = mesh.positions[face * per_face + j * (n + 1) + i];
                p[axis] = negative ? -1 : 1;
                p[u] = 2.0 * i / n - 1;
                p[v] = 2.0 * j / n - 1;
            }
        }
        t = grid_cells(&mesh, t, face * per_face, n, n, NULL);
    }
    lattice_weld(arena, &mesh, n);
    return mesh;
}

struct gn_mesh gn_mesh_octahedron(struct gn_arena *arena, uint32_t n)
{
    uint32_t per_face = (n + 1) * (n + 2) / 2, t = 0;
    struct gn_mesh mesh = mesh_alloc(arena, 8 * per_face, 8 * n * n);
    for (uint32_t face = 0; face < 8; face++) {
        double sign[3] = {face & 1 ? -1 : 1, face & 2 ? -1 : 1, face & 4 ? -1 : 1};
        bool flip = sign[0] * sign[1] * sign[2] < 0;
        uint32_t base = face * per_face, row = 0;
        for (uint32_t j = 0; j <= n; j++) {
            for (uint32_t i = 0; i + j <= n; i++) {
                double *p = mesh.positions[base + row + i];
                /* + 0.0 turns -0 into 0: shared vertices have equal bits. */
                p[0] = sign[0] * i / n + 0.0;
                p[1] = sign[1] * j / n + 0.0;
                p[2] = sign[2] * (n - i - j) / n + 0.0;
            }
            uint32_t above = row + n + 1 - j;
            for (uint32_t i = 0; i + j < n; i++) {
                uint32_t a = base + row + i, b = a + 1, c = base + above + i;
                triangle_set(&mesh, t++, a, flip ? c : b, flip ? b : c);
                if (i + j + 1 < n)
                    triangle_set(&mesh, t++, b, flip ? c : c + 1, flip ? c + 1 : c);
            }
            row = above;
        }
    }
    lattice_weld(arena, &mesh, n);
    return mesh;
}

struct gn_mesh gn_mesh_fan(struct gn_arena *arena, struct gn_random *random, uint32_t spokes, double height)
{
    struct gn_mesh mesh = mesh_alloc(arena, spokes + 1, spokes);
    position_set(&mesh, 0, 0, 0, height);
    for (uint32_t s = 0; s < spokes; s++) {
        double angle = 2 * PI * s / spokes, radius = gn_random_range(random, 0.5, 1);
        position_set(&mesh, 1 + s, round(1024 * radius * cos(angle)) / 1024 + 0.0,
                     round(1024 * radius * sin(angle)) / 1024 + 0.0, 0);
        triangle_set(&mesh, s, 0, 1 + s, 1 + (s + 1) % spokes);
    }
    return mesh;
}

struct gn_mesh gn_mesh_t_junctions(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude,
                                   bool bent)
{
    uint32_t rows = n / 2, fine = 2 * n;
    uint32_t coarse_count = (n + 1) * (rows + 1);
    struct gn_mesh mesh = mesh_alloc(arena, coarse_count + (fine + 1) * (n + 1), 2 * n * rows + 2 * fine * n);
    for (uint32_t j = 0; j <= rows; j++) {
        for (uint32_t i = 0; i <= n; i++) {
            double z = bent ? gn_random_range(random, -amplitude, amplitude) : lattice_height(random, amplitude);
            position_set(&mesh, j * (n + 1) + i, 2.0 * i / n - 1, (double)j / rows - 1, z);
        }
    }
    for (uint32_t j = 0; j <= n; j++) {
        for (uint32_t i = 0; i <= fine; i++) {
            double z = bent ? gn_random_range(random, -amplitude, amplitude) : lattice_height(random, amplitude);
            if (j == 0) {
                const double (*seam)[3] = (const double (*)[3])mesh.positions + rows * (n + 1);
                z = (seam[i / 2][2] + seam[(i + 1) / 2][2]) / 2;
            }
            position_set(&mesh, coarse_count + j * (fine + 1) + i, 2.0 * i / fine - 1, (double)j / n, z);
        }
    }
    uint32_t t = grid_cells(&mesh, 0, 0, n, rows, random);
    grid_cells(&mesh, t, coarse_count, fine, n, random);
    return mesh;
}

struct gn_mesh gn_mesh_soup(struct gn_arena *arena, struct gn_random *random, uint32_t count, double size)
{
    struct gn_mesh mesh = mesh_alloc(arena, 3 * count, count);
    for (uint32_t t = 0; t < count; t++) {
        double centre[3];
        for (int c = 0; c < 3; c++)
            centre[c] = gn_random_range(random, -1, 1);
        double area2;
        do {
            double e[2][3];
            for (uint32_t k = 0; k < 3; k++)
                position_set(&mesh, 3 * t + k, centre[0] + gn_random_range(random, -size / 2, size / 2),
                             centre[1] + gn_random_range(random, -size / 2, size / 2),
                             centre[2] + gn_random_range(random, -size / 2, size / 2));
            for (int c = 0; c < 3; c++) {
                e[0][c] = mesh.positions[3 * t + 1][c] - mesh.positions[3 * t][c];
                e[1][c] = mesh.positions[3 * t + 2][c] - mesh.positions[3 * t][c];
            }
            area2 = 0;
            for (int c = 0; c < 3; c++) {
                int d = (c + 1) % 3;
                double n = e[0][c] * e[1][d] - e[0][d] * e[1][c];
                area2 += n * n;
            }
            /* Slivers are another mesh's subject. */
        } while (!(area2 > 1e-4 * size * size * size * size));
        triangle_set(&mesh, t, 3 * t, 3 * t + 1, 3 * t + 2);
    }
    return mesh;
}

struct gn_mesh gn_mesh_quad(struct gn_arena *arena)
{
    struct gn_mesh mesh = mesh_alloc(arena, 4, 2);
    position_set(&mesh, 0, -1, -1, 0);
    position_set(&mesh, 1, 1, -1, 0);
    position_set(&mesh, 2, 1, 1, 0);
    position_set(&mesh, 3, -1, 1, 0);
    cell_set(&mesh, 0, (const uint32_t[4]){0, 1, 2, 3}, false);
    return mesh;
}

struct gn_mesh gn_mesh_triangle(struct gn_arena *arena)
{
    struct gn_mesh mesh = mesh_alloc(arena, 3, 1);
    position_set(&mesh, 0, -1, -1, 0);
    position_set(&mesh, 1, 1, -1, 0);
    position_set(&mesh, 2, 0, 1, 0);
    triangle_set(&mesh, 0, 0, 1, 2);
    return mesh;
}

struct gn_mesh gn_mesh_of(struct gn_arena *arena, struct gn_random *random, const struct gn_mesh_spec *spec)
{
    switch (spec->kind) {
    case GN_MESH_HEIGHT_FIELD:
        return gn_mesh_height_field(arena, random, spec->n, spec->size);
    case GN_MESH_LATTICE:
        return gn_mesh_lattice(arena, random, spec->n, spec->size);
    case GN_MESH_BLOB:
        return gn_mesh_blob(arena, random, spec->n, spec->m, spec->size);
    case GN_MESH_TORUS:
        return gn_mesh_torus(arena, spec->n, spec->m, spec->size);
    case GN_MESH_BOX:
        return gn_mesh_box(arena, spec->n);
    case GN_MESH_OCTAHEDRON:
        return gn_mesh_octahedron(arena, spec->n);
    case GN_MESH_FAN:
        return gn_mesh_fan(arena, random, spec->n, spec->size);
    case GN_MESH_T_JUNCTIONS:
        return gn_mesh_t_junctions(arena, random, spec->n, spec->size, spec->m != 0);
    case GN_MESH_SOUP:
        return gn_mesh_soup(arena, random, spec->n, spec->size);
    case GN_MESH_QUAD:
        return gn_mesh_quad(arena);
    case GN_MESH_TRIANGLE:
        break;
    }
    return gn_mesh_triangle(arena);
}

struct gn_mesh gn_mesh_map(struct gn_arena *arena, const struct gn_mesh *mesh, const double affine[12])
{
    struct gn_mesh out = mesh_alloc(arena, mesh->position_count, mesh->triangle_count);
    for (uint32_t v = 0; v < mesh->position_count; v++) {
        const double *p = mesh->positions[v];
        for (int r = 0; r < 3; r++) {
            const double *row = affine + 4 * r;
            out.positions[v][r] = f32(row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]);
        }
    }
    memcpy(out.triangles, mesh->triangles, mesh->triangle_count * sizeof *mesh->triangles);
    return out;
}

struct gn_mesh gn_mesh_scaled(struct gn_arena *arena, const struct gn_mesh *mesh, double x, double y, double z,
                              double move_x, double move_y, double move_z)
{
    double affine[12] = {x, 0, 0, move_x, 0, y, 0, move_y, 0, 0, z, move_z};
    return gn_mesh_map(arena, mesh, affine);
}

struct gn_mesh gn_mesh_joined(struct gn_arena *arena, const struct gn_mesh *a, const struct gn_mesh *b)
{
    struct gn_mesh out = mesh_alloc(arena, a->position_count + b->position_count,
                                    a->triangle_count + b->triangle_count);
    memcpy(out.positions, a->positions, a->position_count * sizeof *a->positions);
    memcpy(out.positions + a->position_count, b->positions, b->position_count * sizeof *b->positions);
    memcpy(out.triangles, a->triangles, a->triangle_count * sizeof *a->triangles);
    for (uint32_t t = 0; t < b->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            out.triangles[a->triangle_count + t][c] = b->triangles[t][c] + a->position_count;
    return out;
}

struct gn_mesh gn_mesh_unshared(struct gn_arena *arena, const struct gn_mesh *mesh)
{
    struct gn_mesh out = mesh_alloc(arena, 3 * mesh->triangle_count, mesh->triangle_count);
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        for (uint32_t c = 0; c < 3; c++) {
            memcpy(out.positions[3 * t + c], mesh->positions[mesh->triangles[t][c]], sizeof *out.positions);
            out.triangles[t][c] = 3 * t + c;
        }
    }
    return out;
}

void gn_mesh_deactivate(struct gn_random *random, struct gn_mesh *mesh, double share)
{
    uint32_t keep = gn_random_below(random, mesh->triangle_count);
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        if (gn_random_unit(random) >= share || t == keep)
            continue;
        uint32_t corners = 1 + gn_random_below(random, 7);
        for (uint32_t k = 0; k < 3; k++) {
            if (!(corners >> k & 1))
                continue;
            double *p = mesh->positions[mesh->triangles[t][k]];
            p[0] = p[1] = p[2] = NAN;
        }
    }
}
