#version 460
/* SPDX-License-Identifier: Apache-2.0 */
layout(location = 0) out float t;
void main()
{
    t = 1;
}
