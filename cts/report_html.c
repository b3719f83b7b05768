/* SPDX-License-Identifier: Apache-2.0 */
#include "cts/results.h"
#include <string.h>
bool gn_results_html_write(const struct gn_results *results, const char *out, const char *path, char *out_error, size_t error_size)
{
    (void)results;(void)out;
    return gn_file_write(path, "", 0, out_error, error_size);
}
