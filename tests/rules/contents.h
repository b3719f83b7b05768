/* SPDX-License-Identifier: Apache-2.0 */
/* Rows of rules that have a file of their own: for the test that every rule has a firing and a silent one. */
#ifndef GN_TESTS_RULES_CONTENTS_H
#define GN_TESTS_RULES_CONTENTS_H

/* Adds the rows that are about the rule. */
void contents_rows_count(const char *rule, int *firing, int *silent);
/* A test of cmocka that runs them all. */
void contents_rows_run(void **state);

#endif
