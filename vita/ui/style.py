"""Small style sheets for the page. viser gives every button its uuid as its HTML id, so rules can name them.

If a browser ignores these rules the page still works: buttons then stand one per line.
"""

from __future__ import annotations

from collections.abc import Iterable

import viser

from vita.ui.words import LOGO, Rgb, hexed

BASE = """
.vita{font-size:13px;line-height:1.4;color:#18202c;margin:0 10px 8px}
.vita b{font-weight:650}
.vita .row{display:flex;align-items:center;gap:8px}
.vita .grow{flex:1;min-width:0;line-height:1.6;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.vita .dim{color:#667085}
.vita .ink{color:#18202c}
#vita-run{min-height:64px;margin-bottom:4px}
.vita.rates{display:flex;justify-content:space-between;font-size:11.5px;color:#667085;margin-bottom:4px;
cursor:help}
.vita.rates b{font-weight:600;color:#475467}
#vita-run .row{margin-bottom:4px}
.vita .link{color:#0d766e;border:1px solid #cfe5e2;border-radius:999px;padding:1px 9px;font-weight:600;
font-size:12px;white-space:nowrap}
.vita .link:hover{background:#f2f8f7}
.vita .num{font-variant-numeric:tabular-nums}
.vita .chip{color:#fff;border-radius:999px;padding:2px 11px;font-weight:650;font-size:12.5px;
white-space:nowrap}
.vita .dot{width:10px;height:10px;border-radius:50%;flex:none;display:inline-block}
.vita .bar{width:4px;align-self:stretch;border-radius:2px;flex:none}
.vita .card{border:1px solid #e4e7ec;border-radius:8px;padding:5px 10px;background:#fff}
.vita .prompt{border-left:5px solid #0d766e;background:#f2f8f7}
.vita .hint{background:#f5f8ff;border-color:#d6e2fb}
.vita .warn{color:#b54708}
.vita ol{margin:4px 0 0;padding-left:20px}
.vita h4{margin:6px 0 3px;font-size:12px;font-weight:650;color:#475467;
display:flex;justify-content:space-between}
.vita .list{border:1px solid #e4e7ec;border-radius:8px;overflow:hidden}
.vita .item{display:flex;align-items:center;gap:8px;padding:2px 8px;border-top:1px solid #f0f2f5}
.vita .item:first-child{border-top:0}
.vita .item.on{background:#eef6ff}
.vita label{cursor:pointer}
.vita label.x{color:#98a2b3;padding:0 4px;font-size:16px;line-height:1;border-radius:4px}
.vita label.x:hover{color:#dc2626;background:#fee4e2}
.vita .quality{width:34px;height:5px;border-radius:3px;background:#e4e7ec;flex:none;overflow:hidden}
.vita .quality i{display:block;height:100%}
.vita .lost{background:#fef3f2;color:#b42318;font-size:12px;padding:1px 8px 4px 26px}
.vita .pair{display:flex;gap:10px;align-items:flex-start}
.vita .loupe{position:relative;width:152px;height:104px;flex:none;border-radius:4px;overflow:hidden}
.vita .loupe img,.vita .loupe svg{position:absolute;inset:0;width:100%;height:100%}
.vita .loupe img{image-rendering:pixelated}
.vita .keys{font-size:11.5px}
.vita .take{color:#fff;background:#16a34a;border-radius:6px;padding:1px 9px;font-weight:600;
display:inline-block;margin-top:3px}
.vita.mode{display:flex;gap:2px;background:#e9edf2;border-radius:8px;padding:2px;margin-bottom:6px}
.vita.mode .half{flex:1;text-align:center;border-radius:6px;padding:1px 6px;font-size:12.5px;font-weight:600;
color:#475467;white-space:nowrap}
.vita.mode .half.on{background:#0d766e;color:#fff;cursor:default}
.vita.mode.off .half:not(.on){color:#98a2b3;cursor:not-allowed}
.vita .steps{display:flex;gap:4px;margin-bottom:5px}
.vita .steps span{flex:1;text-align:center;border-radius:6px;background:#eef1f5;color:#667085;font-size:12px;
font-weight:600;padding:1px 0}
.vita .steps .past{background:#dff3ef;color:#0d766e}
.vita .steps .now{background:#0d766e;color:#fff}
.vita .facts{display:grid;grid-template-columns:82px 84px 1fr;gap:1px 8px;font-size:12.5px}
.vita .facts span{color:#667085}
.vita .facts b{font-weight:600;white-space:nowrap}
.vita .facts .wide{grid-column:2 / 4;overflow:hidden;text-overflow:ellipsis}
.vita .gauges{display:grid;gap:3px}
.vita .gauge{display:grid;grid-template-columns:82px 1fr 84px 84px;align-items:center;gap:8px;
font-size:12px;line-height:1.3;cursor:help}
.vita .gauge .track{height:6px;border-radius:3px;background:#e4e7ec;overflow:hidden}
.vita .gauge .track i{display:block;height:100%;border-radius:3px;transition:width .2s}
.vita .gauge b{font-weight:600;text-align:right;white-space:nowrap}
.vita .gauge .word{font-weight:600;white-space:nowrap}
.vita .finding{display:flex;gap:7px;align-items:flex-start;font-size:12px;line-height:1.35;padding:3px 0}
.vita .finding i{flex:none;width:15px;height:15px;margin-top:1px;border-radius:50%;color:#fff;
font-size:10.5px;font-style:normal;font-weight:700;line-height:15px;text-align:center}
.vita .finding.bad{color:#b42318}
.vita .finding.warning{color:#93370d}
.vita .finding.more{color:#667085;padding-left:22px;cursor:help}
.vita .doctor{border-top:1px solid #f0f2f5;padding:1px 8px}
.vita h4 .verdict{font-weight:600;margin:0 auto 0 8px}
.vita.about{font-size:11.5px;line-height:1.35;color:#667085;margin:-4px 10px 6px}
.vita .evidence{display:flex;align-items:center;gap:8px;font-size:12px;color:#667085;margin-top:3px}
.vita.who{display:flex;align-items:center;gap:8px;font-size:12px;font-weight:600;color:#344054;
background:#eef4ff;border-radius:6px;padding:2px 8px;margin-bottom:6px}
.vita.who .take{color:#fff;background:#0d766e;border-radius:6px;padding:0 9px}
.vita.who .take.off{background:#98a2b3}
.vita .tally{display:grid;grid-template-columns:1fr 1fr 1fr;gap:1px 8px;font-size:12px;color:#667085;
cursor:help}
.vita .tally b{font-weight:600;color:#18202c}
.vita .small{font-size:11.5px;white-space:nowrap}
.vita .id{width:26px;flex:none;font-size:11.5px}
.vita .more{font-size:12px;line-height:1.4;color:#475467;background:#eef6ff;padding:1px 8px 6px 42px}
.vita .more code{font-size:11.5px}
.vita .empty{padding:8px 10px;color:#667085}
"""

HEIGHTS = f"""
div:has(> [data-dock-leaf] #vita-run){{flex:0 0 auto!important;min-height:190px!important}}
[data-dock-leaf] div:has(#vita-run){{flex-basis:auto!important;height:auto!important}}
div:has(> [data-dock-leaf] span.vita-tabs){{flex-grow:1!important}}
div:has(> [data-dock-leaf] span.vita-plots){{flex:0 0 clamp(184px,25vh,260px)!important}}
[data-dock-region-handle]{{height:10px!important}}
[data-dock-griphandle]{{height:7px!important}}
[data-dock-strip][role=tablist] [data-dock-tab]{{height:27px!important}}
[data-testid="floating-panel-handle"]{{height:34px!important;
background:url("{LOGO}") no-repeat 44px center/auto 26px}}
[data-dock-leaf] div:has(> div > span.vita-tabs),[data-dock-leaf] div:has(> div > .vita-run-sheet)
{{padding-top:6px!important}}
[data-dock-leaf] .uplot-container{{border:0!important}}
div:has(> .uplot-container){{margin-top:0!important}}
"""
"""Sizes of viser's docked panels; without these rules they are merely less economical."""

TABS_MARK = '<span class="vita-tabs"></span>'
"""By this the style sheet knows the panel of the tabs, whichever tab is open."""


PLOTS_MARK = '<span class="vita-plots"></span>'
"""The same for the panel below the tabs."""


def own(button: viser.GuiButtonHandle) -> str:
    """CSS selector of a button."""
    return f'[id="{button._impl.uuid}"]'


def side_by_side(buttons: Iterable[viser.GuiButtonHandle], columns: int) -> str:
    """Put buttons next to each other instead of one per line."""
    share = 100.0 / columns
    rules = ""
    for index, button in enumerate(buttons):
        left = 10 if index % columns == 0 else 3
        right = 10 if index % columns == columns - 1 else 3
        rules += (
            f"div:has(> {own(button)}){{display:inline-block;vertical-align:top;width:{share:.3f}%;"
            f"margin:0!important;padding:0 {right}px 5px {left}px!important;box-sizing:border-box}}"
        )
    return rules


def inputs_side_by_side(inputs: Iterable[viser.GuiDropdownHandle]) -> str:
    """Two dropdowns in a row, with labels as narrow as their words."""
    outer, label = [], []
    for handle in inputs:
        name = f'label[for="{handle._impl.uuid}"]'
        outer.append(f"div:has(> div > div > p > {name})")
        label.append(f"div:has(> p > {name})")
    return (
        f"{','.join(outer)}{{display:inline-block;width:50%;box-sizing:border-box;margin:0!important;"
        f"padding:0 10px 5px!important}}{','.join(label)}{{width:auto!important;padding-right:6px!important}}"
    )


def beside(dropdown: viser.GuiDropdownHandle, button: viser.GuiButtonHandle, share: float) -> str:
    """A dropdown that takes `share` of the line, and a button in the rest of it."""
    name, wide = f'label[for="{dropdown._impl.uuid}"]', 100 * share
    line = "display:inline-block;vertical-align:top;box-sizing:border-box;margin:0!important;"
    return (
        f"div:has(> div > div > p > {name}){{{line}width:{wide:.0f}%;padding:0 3px 5px 10px!important}}"
        f"div:has(> p > {name}){{width:auto!important;padding-right:6px!important}}"
        f"div:has(> {own(button)}){{{line}width:{100 - wide:.0f}%;padding:0 10px 5px 3px!important}}"
    )


def hidden(buttons: Iterable[viser.GuiButtonHandle]) -> str:
    """Buttons that are pressed through a <label for=...> in a list."""
    selectors = ",".join(f"div:has(> {own(button)})" for button in buttons)
    return f"{selectors}{{display:none!important}}" if selectors else ""


def tool(button: viser.GuiButtonHandle, color: Rgb, on: bool) -> str:
    """A tool's look: an outlined button with a coloured edge, filled while it is in hand."""
    tint = hexed(color)
    face = (
        f"background:{tint}!important;color:#fff!important;border:1px solid {tint}!important"
        if on
        else "background:#fff!important;color:#18202c!important;border:1px solid #d0d5dd!important"
    )
    return (
        f"{own(button)}{{{face};border-left:5px solid {tint}!important;height:28px!important;"
        f"font-size:12.5px;font-weight:600;padding:0 4px}}"
        f"{own(button)}:hover{{filter:brightness(.97)}}"
    )


def plain(buttons: Iterable[viser.GuiButtonHandle]) -> str:
    """Quiet secondary buttons."""
    selectors = ",".join(own(button) for button in buttons)
    return (
        f"{selectors}{{background:#fff!important;color:#344054!important;border:1px solid #d0d5dd!important;"
        f"font-weight:500}}"
    )


def filled(button: viser.GuiButtonHandle, color: Rgb) -> str:
    return f"{own(button)}{{background:{hexed(color)}!important;color:#fff!important;height:34px!important}}"


def big(button: viser.GuiButtonHandle, color: Rgb) -> str:
    """Start and Stop."""
    return (
        f"{own(button)}{{height:38px!important;font-size:16px;font-weight:700;"
        f"background:{hexed(color)}!important;color:#fff!important}}"
        f"{own(button)}:disabled{{background:#e4e7ec!important;color:#98a2b3!important}}"
    )


def latching(button: viser.GuiButtonHandle) -> str:
    """The emergency stop: red on yellow, as on machines."""
    return (
        f"{own(button)}{{height:38px!important;font-size:13px;font-weight:700;padding:0 4px;"
        f"background:#facc15!important;color:#991b1b!important;border:2px solid #dc2626!important}}"
    )


def out_of_reach(except_for: Iterable[viser.GuiButtonHandle]) -> str:
    """How the controls look at a page that only watches. They still answer, by saying who drives."""
    spared = "".join(f":not({own(button)})" for button in except_for)
    return (
        f"[data-dock-leaf] .mantine-Button-root{spared},[data-dock-leaf] .mantine-Slider-root,"
        f"[data-dock-leaf] .mantine-Input-wrapper,[data-dock-leaf] .mantine-Checkbox-root,"
        f"#vita-mode .half:not(.on),#vita-faults .link,.vita label.x{{opacity:.45}}"
    )


def sheet(*rules: str) -> str:
    return "<style>" + "".join(rules) + "</style>"
