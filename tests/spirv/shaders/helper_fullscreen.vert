/* SPDX-License-Identifier: Apache-2.0 */
//! why: covers every pixel, for fragment shaders that come alone
#version 460
void main()
{
    gl_Position = vec4(gl_VertexIndex == 1 ? 3 : -1, gl_VertexIndex == 2 ? 3 : -1, 0, 1);
}
