/* SPDX-License-Identifier: Apache-2.0 */
/* Memory of a case: aligned, zeroed, apart from each other, and gone at once. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "cts/arena.h"

/* Sizes around those of a block, so that the large ones come between the small ones. */
static void pieces_are_zeroed_aligned_and_apart(void **state)
{
    (void)state;
    static const size_t sizes[] = {0, 1, 15, 16, 17, 4096, 65520, 65535, 65536, 65537, 3, 1000000, 5, 64, 300000, 8};
    enum { COUNT = sizeof sizes / sizeof sizes[0], ROUNDS = 20 };
    struct gn_arena arena = {0};
    static unsigned char *pieces[COUNT * ROUNDS];
    for (size_t i = 0; i < COUNT * ROUNDS; i++) {
        const size_t size = sizes[i % COUNT];
        pieces[i] = gn_arena_alloc(&arena, size, 1);
        assert_non_null(pieces[i]);
        assert_int_equal((uintptr_t)pieces[i] % _Alignof(max_align_t), 0);
        for (size_t k = 0; k < size; k++) {
            assert_int_equal(pieces[i][k], 0);
        }
        memset(pieces[i], (int)(i % 255) + 1, size);
    }
    for (size_t i = 0; i < COUNT * ROUNDS; i++) {
        for (size_t k = 0; k < sizes[i % COUNT]; k++) {
            assert_int_equal(pieces[i][k], (int)(i % 255) + 1);
        }
    }
    gn_arena_finish(&arena);
    assert_null(arena.last);
    gn_arena_finish(&arena); /* an empty one, too */
}

static void text_is_formatted_whole(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    char expected[5000];
    memset(expected, 'x', sizeof expected - 1);
    expected[sizeof expected - 1] = '\0';
    assert_string_equal(gn_arena_printf(&arena, "%d of %s", 7, "nine"), "7 of nine");
    assert_string_equal(gn_arena_printf(&arena, "%s", expected), expected);
    assert_string_equal(gn_arena_printf(&arena, "%s", ""), "");
    gn_arena_finish(&arena);
}

/* What a worker says and how it ends when memory cannot be had. */
static void a_lack_of_memory_ends_the_process(void **state)
{
    (void)state;
    static const size_t wishes[][2] = {
        {SIZE_MAX, 2}, /* the product overflows */
        {SIZE_MAX - 3, 1}, /* the rounding overflows */
        {SIZE_MAX / 2, 1}, /* no machine has it */
    };
    for (size_t i = 0; i < sizeof wishes / sizeof wishes[0]; i++) {
        int ends[2];
        assert_int_equal(pipe(ends), 0);
        const pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            struct gn_arena arena = {0};
            dup2(ends[1], STDERR_FILENO);
            gn_arena_alloc(&arena, wishes[i][0], wishes[i][1]);
            _exit(0);
        }
        close(ends[1]);
        char text[4096];
        size_t length = 0;
        ssize_t got = 0;
        while ((got = read(ends[0], text + length, sizeof text - 1 - length)) > 0) {
            length += (size_t)got;
        }
        text[length] = '\0';
        close(ends[0]);
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status));
        assert_int_equal(WEXITSTATUS(status), 3);
        assert_non_null(strstr(text, "no memory for"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_are_zeroed_aligned_and_apart),
        cmocka_unit_test(text_is_formatted_whole),
        cmocka_unit_test(a_lack_of_memory_ends_the_process),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
