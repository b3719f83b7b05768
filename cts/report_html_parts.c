/* SPDX-License-Identifier: Apache-2.0 */
/* Pieces of report.html. Nothing in it comes from the network: no font, no script, no image. */
#include "cts/report_html_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/describe.h"

const char gn_html_style[] =
    ":root{color-scheme:light dark;--bg:#fbfbfa;--card:#fff;--text:#1c2126;--soft:#5b6670;--line:#dde1e5;"
    "--good:#1a6e3c;--goodbg:#e6f4ea;--bad:#a3180f;--badbg:#fdecea;--warn:#7a4b00;--warnbg:#fff3dc;--code:#"
    "f0f2f4;"
    "--mark:#fde3e0}\n"
    "@media(prefers-color-scheme:dark){:root{--bg:#15181b;--card:#1d2125;--text:#e5e8eb;--soft:#9aa5af;--"
    "line:#353b41;"
    "--good:#7fd6a0;--goodbg:#16301f;--bad:#ff9d94;--badbg:#3a1a17;--warn:#f3c46b;--warnbg:#35280f;--code:#"
    "262b30;"
    "--mark:#4a211d}}\n"
    "*{box-sizing:border-box}body{margin:0;background:var(--bg);color:var(--text);font:15px/1.5 "
    "system-ui,sans-serif}\n"
    "main{max-width:1180px;margin:0 auto;padding:24px 20px 80px}h1{font-size:17px;margin:0;color:var(--soft);"
    "font-weight:600}h2{font-size:21px;margin:44px 0 6px}h3{font-size:16px;margin:0}p{margin:6px 0 "
    "12px;max-width:75ch}\n"
    "a{color:inherit}code,.mono{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;font-size:.9em}\n"
    ".verdict{margin:12px 0 18px;padding:18px "
    "20px;border-radius:10px;font-size:25px;font-weight:650;line-height:1.3}\n"
    ".verdict small{display:block;font-size:15px;font-weight:400;margin-top:6px;color:var(--text)}\n"
    ".ok{background:var(--goodbg);color:var(--good)}.no{background:var(--badbg);color:var(--bad)}"
    ".meh{background:var(--warnbg);color:var(--warn)}\n"
    ".facts{display:grid;grid-template-columns:max-content 1fr;gap:2px 16px;margin:0}.facts "
    "dt{color:var(--soft)}"
    ".facts dd{margin:0;overflow-wrap:anywhere}\n"
    ".tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(158px,1fr));gap:10px;margin:18px 0}\n"
    ".tile{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:10px 14px;overflow-wrap:anywhere}"
    ".tile b{display:block;font-size:22px;font-weight:650;font-variant-numeric:tabular-nums;white-space:nowrap}.tile span{color:var(--soft);font-size:13px}\n"
    ".tile.no b{color:var(--bad)}.tile.no{background:var(--badbg)}.tile.meh b{color:var(--warn)}\n"
    "table{border-collapse:collapse;background:var(--card);border:1px solid "
    "var(--line);font-size:14px;width:100%}\n"
    "th,td{padding:5px 10px;text-align:left;border-bottom:1px solid var(--line);vertical-align:middle}"
    "th{color:var(--soft);font-weight:600;font-size:13px}td.n,th.n{text-align:right;font-variant-numeric:"
    "tabular-nums;"
    "white-space:nowrap}\n"
    ".wide{overflow-x:auto;border-radius:8px}tr.total td{font-weight:650}svg{display:block}\n"
    ".badge{display:inline-block;padding:0 "
    "9px;border-radius:10px;font-size:12.5px;font-weight:650;line-height:20px}"
    ".soft{color:var(--soft)}.small{font-size:13px}\n"
    ".key{display:inline-flex;align-items:center;gap:6px;margin-right:14px;white-space:nowrap;font-size:13px}"
    ".key i{width:13px;height:13px;border-radius:3px;border:1px solid rgba(128,128,128,.55)}"
    ".key i+i{margin-left:-4px}\n"
    "details.case{background:var(--card);border:1px solid var(--line);border-radius:8px;margin:12px 0}"
    "details.case>summary{padding:11px 16px;cursor:pointer;list-style-position:inside}"
    "details.case>summary h3{display:inline;margin:0 8px}\n"
    ".body{padding:2px 16px 16px;display:grid;grid-template-columns:minmax(0,1fr);gap:6px 28px}"
    "@media(min-width:820px){.body.pic{grid-template-columns:max-content minmax(0,1fr)}}\n"
    ".body img{image-rendering:pixelated;border:1px solid "
    "var(--line);display:block;max-width:100%;height:auto}"
    ".rendered{display:flex;flex-wrap:wrap;gap:6px 16px}.rendered img{width:288px;max-width:100%;height:auto;"
    "image-rendering:pixelated;border:1px solid var(--line);display:block}"
    "figure{margin:4px 0}figcaption{font-size:13px;color:var(--soft);max-width:340px;margin-top:6px}\n"
    ".body table{margin:8px 0;width:auto}td.diff{background:var(--mark);font-weight:650}\n"
    "pre,.copy{background:var(--code);border-radius:6px;padding:7px 11px;margin:6px 0;overflow-x:auto;"
    "font:13px/1.5 "
    "ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;white-space:pre-wrap;overflow-wrap:anywhere}"
    ".copy{user-select:all;-webkit-user-select:all}\n"
    "input{font:inherit;padding:7px 11px;border:1px solid "
    "var(--line);border-radius:6px;background:var(--card);"
    "color:var(--text);width:min(420px,100%);margin:6px 0 10px}\n"
    ".meaning{display:grid;grid-template-columns:max-content 1fr;gap:4px 14px;font-size:14px;margin:8px "
    "0;max-width:95ch}\n";

const char gn_html_script[] =
    "document.getElementById('filter').addEventListener('input',function(){"
    "var words=this.value.toLowerCase().split(/\\s+/).filter(Boolean),n=0;"
    "document.querySelectorAll('#cases tbody tr').forEach(function(row){"
    "var text=row.textContent.toLowerCase(),show=words.every(function(w){return text.indexOf(w)>=0});"
    "row.hidden=!show;n+=show});"
    "document.getElementById('shown').textContent=n+' shown'});";

void gn_html_text(FILE *file, const char *text)
{
    for (; *text; text++) {
        switch (*text) {
        case '&':
            fputs("&amp;", file);
            break;
        case '<':
            fputs("&lt;", file);
            break;
        case '>':
            fputs("&gt;", file);
            break;
        case '"':
            fputs("&quot;", file);
            break;
        case '\'':
            fputs("&#39;", file);
            break;
        default:
            fputc(*text, file);
        }
    }
}

void gn_html_class_bar(FILE *file, const uint64_t counts[GN_REF_VERDICT_CLASS_COUNT])
{
    const double width = 220, sliver = 4;
    double sizes[GN_REF_VERDICT_CLASS_COUNT], total = 0, spare = width, large = 0, x = 0;
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        total += (double)counts[c];
    if (total <= 0) {
        fputs("<span class=soft>no ray</span>", file);
        return;
    }
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
        bool small = counts[c] && (double)counts[c] / total * width < sliver;
        sizes[c] = small ? sliver : 0;
        spare -= sizes[c];
        large += small ? 0 : (double)counts[c];
    }
    fprintf(file, "<svg width=%g height=16 viewBox=\"0 0 %g 16\" role=img aria-label=\"", width, width);
    bool first = true;
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
        char number[32];
        if (counts[c])
            fprintf(file, "%s%s %s", first ? "" : ", ", gn_format_grouped(counts[c], number),
                    gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
        first = first && !counts[c];
    }
    fputs("\">", file);
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
        char number[32];
        if (!counts[c])
            continue;
        double w = sizes[c] > 0 ? sizes[c] : (double)counts[c] / large * spare;
        fprintf(file, "<rect x=%.2f y=0 width=%.2f height=16 fill=\"#%06X\"><title>%s %s</title></rect>", x,
                w, gn_picture_colour((uint8_t)c), gn_format_grouped(counts[c], number),
                gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
        x += w;
    }
    fprintf(file,
            "<rect x=.5 y=.5 width=%g height=15 fill=none stroke=\"#808080\" stroke-opacity=.5 /></svg>",
            width - 1);
}

void gn_html_class_key(FILE *file, enum gn_ref_verdict_class cls)
{
    fprintf(file,
            "<span class=key><i style=\"background:#%06X\"></i><i style=\"background:#%06X\"></i>%s</span>",
            gn_picture_colour((uint8_t)cls), gn_picture_colour((uint8_t)(cls | 0x80)),
            gn_ref_verdict_class_name(cls));
}

void gn_html_error_bar(FILE *file, double median, double p999, double max, double bound, bool wrong)
{
    const double width = 220, least = 0.05, most = bound * 10;
    const double scale = width / log(most / least);
#define AT(value) (scale * log(fmin(fmax((value), least), most) / least))
    if (!(max > 0)) {
        fputs("<span class=soft>none measured</span>", file);
        return;
    }
    bool over = wrong && !(max <= bound);
    fprintf(
        file,
        "<svg width=%g height=20 viewBox=\"0 0 %g 20\" role=img aria-label=\"median %.3g, 99.9 percent %.3g, "
        "maximum %.3g, bound %.3g\"><rect x=0 y=9 width=%g height=2 fill=\"#808080\" fill-opacity=.35 />"
        "<rect x=%.1f y=5 width=%.1f height=10 fill=\"#0072B2\" fill-opacity=.55><title>median %.3g to 99.9 "
        "%% "
        "%.3g</title></rect>",
        width, width, median, p999, max, bound, width, AT(median), fmax(AT(p999) - AT(median), 2), median,
        p999);
    fprintf(file,
            "<circle cx=%.1f cy=10 r=4 fill=\"%s\"><title>maximum %.3g</title></circle>"
            "<rect x=%.1f y=0 width=2 height=20 fill=\"#D55E00\"><title>bound %.3g</title></rect></svg>",
            fmin(AT(max), width - 4), over ? "#D00000" : "#0072B2", max, AT(bound), bound);
#undef AT
}

size_t gn_base64_length(size_t length)
{
    return (length + 2) / 3 * 4;
}

void gn_base64(const uint8_t *data, size_t length, char *out)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < length; i += 3) {
        const size_t n = length - i;
        const uint32_t word =
            (uint32_t)data[i] << 16 | (n > 1 ? (uint32_t)data[i + 1] << 8 : 0) | (n > 2 ? data[i + 2] : 0);
        *out++ = digits[word >> 18];
        *out++ = digits[word >> 12 & 63];
        *out++ = n > 1 ? digits[word >> 6 & 63] : '=';
        *out++ = n > 2 ? digits[word & 63] : '=';
    }
    *out = 0;
}

bool gn_html_picture(FILE *file, const char *folder, const struct gn_results_case *cs)
{
    char path[4096], error[256], *data = NULL;
    size_t length = 0;
    snprintf(path, sizeof path, "%s/%s", folder, cs->picture);
    if (!gn_file_read(path, 16 << 20, &data, &length, error, sizeof error))
        return false;
    /* A whole factor keeps every ray's square the same size. A reduced picture has its own width. */
    uint32_t least = 340,
             longest = cs->picture_width > cs->picture_height ? cs->picture_width : cs->picture_height;
    uint32_t factor = longest && longest < least ? (least + longest - 1) / longest : 1;
    if (factor > 32)
        factor = 32;
    uint32_t width = cs->picture_width * factor;
    if (width > 480)
        width = 480;
    fprintf(file, "<img width=%u alt=\"one pixel per ray, coloured by verdict\" src=\"data:image/png;base64,",
            width);
    char *encoded = malloc(gn_base64_length(length) + 1);
    if (encoded) {
        gn_base64((const uint8_t *)data, length, encoded);
        fputs(encoded, file);
    }
    free(encoded);
    fputs("\">", file);
    free(data);
    return true;
}
