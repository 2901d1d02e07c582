"""Texts in encodings of other languages are read as what they are, and the assumption is named."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.texts.encoding import decode, describe_encoding

HEADERS = {
    "cp932": "姿勢番号,J1(度),J2(度),無負荷X(mm),負荷X(mm)",
    "euc_jp": "姿勢番号,関節1,関節2,無負荷X(mm),負荷X(mm)",
    "gb18030": "序号,关节1/°,关节2/°,空载X/mm,加载X/mm",
    "big5": "編號,關節1,關節2,空載X(mm),負載X(mm)",
    "cp949": "자세,관절1(도),관절2(도),무부하X(mm),부하X(mm)",
    "cp1251": "№;А1, град;А2, град;X без нагрузки, мм;X под нагрузкой, мм",
    "koi8_r": "Поза;А1, град;А2, град;X без нагрузки, мм;X под нагрузкой, мм",
    "cp1254": "Sıra;Açıklama;Eklem 1 açısı [°];Yüksüz X [mm];Yüklü X [mm]",
    "cp1252": "Point d’appui – repère;Axe 1 [°];À vide X [mm]",
    "latin-1": "Stützpunkt;Achse 1 [°];Höhe [mm];Größe;Réflecteur;Déchargé",
}


@pytest.mark.parametrize("encoding", HEADERS)
def test_the_encoding_is_the_one_whose_words_are_known(encoding):
    text = f"{HEADERS[encoding]}\n1,2,3\n" * 40
    assert decode("a.csv", text.encode(encoding)) == (text, encoding)


@pytest.mark.parametrize("header", ["ÏÓØ", "«ìì»", "X (ìì)"])
def test_one_short_word_is_there_by_chance(header):
    text = f"name;{header} unloaded x [mm];{header} loaded x [mm]\n1;2;3\n"
    assert decode("a.csv", text.encode("latin-1")) == (text, "latin-1")


@pytest.mark.parametrize(
    "text",
    [
        "Mesures, repère robot\nindex;à vide X mm;chargé X mm\n",
        "robot;Größe\n",
        "robot;posição;ângulo\n",
        "Robot: åben\n",
    ],
)
def test_a_word_in_ascii_shows_no_central_european_encoding(text):
    assert decode("a.csv", text.encode("cp1252")) == (text, "latin-1")
    (note,) = describe_encoding("latin-1")
    assert "read as Latin-1 (Western European): check the names" in note


@pytest.mark.parametrize(
    "text", ["robot;kąt;siła\n", "robot: bez obciążenia\n", "Robot;úhel;zatížení\n", "robot;erő;szög\n"]
)
def test_words_of_central_europe_show_their_encoding(text):
    assert decode("a.csv", text.encode("cp1250")) == (text, "cp1250")


@pytest.mark.parametrize("page", ["c02;2", "\fc02;2", "\f\nc02;2"])
def test_the_end_of_a_printed_page_is_a_blank(page):
    text, _ = decode("a.csv", f"label;x [mm]\nc01;1\n{page}\n".encode())
    assert [line.strip() for line in text.split("\n") if line.strip()] == ["label;x [mm]", "c01;1", "c02;2"]


def test_bytes_of_no_western_encoding_are_refused():
    with pytest.raises(ImportFileError, match="control character"):
        decode("a.csv", b"Gr\xf6\xdfe;x [mm]\n\x81;1\n")


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_without_a_mark_is_read_behind_letters_of_other_scripts(encoding):
    text = "姿勢番号,関節1\n1,-12.5\n2,-13.5\n"
    assert decode("a.csv", text.encode(encoding)) == (text, encoding)


@pytest.mark.parametrize("encoding", ["cp932", "gb18030", "cp949", "cp1251"])
def test_a_damaged_text_in_utf_8_is_refused_and_not_read_in_another_encoding(encoding):
    content = HEADERS[encoding].encode()[:-3] + b"\xff,1,2\n"
    with pytest.raises(ImportFileError, match="the text is damaged: its other bytes are UTF-8"):
        decode("a.csv", content)


def test_a_table_in_shift_jis_is_proposed_and_names_its_encoding(tmp_path):
    name = "Universal Robots UR10e"
    robot = next(known.robot for known in build_nominal_robots() if known.name == name)
    readings = readings_on(robot, seed=4, configurations=12)
    unloaded = 1e3 * readings.position[:, 0]
    rows = np.column_stack([np.rad2deg(readings.joints), unloaded, unloaded - [0.0, 0.0, 0.4]])
    joints = ",".join(f"J{number}(度)" for number in range(1, 7))
    positions = ",".join(f"{state}{axis}(mm)" for state in ("無負荷", "負荷") for axis in "XYZ")
    lines = [f"姿勢番号,{joints},{positions}"]
    lines += [",".join([str(i), *(f"{each:.4f}" for each in row)]) for i, row in enumerate(rows.tolist(), 1)]
    path = tmp_path / "剛性.csv"
    path.write_bytes("\n".join([*lines, ""]).encode("cp932"))
    proposal = js.read(
        path,
        robot=name,
        encoders="motor",
        load_point=[0, 0, 100],
        force=[0, 0, -100],
        units={"force": "N"},
        length_unit="mm",
    )
    (file,) = proposal.accept().files
    assert file.encoding == "cp932"
    assert file.columns[1].header == "J1(度)"
    assert "the file is not valid UTF-8, so it was read as Shift-JIS (Japanese): check the names" in (
        file.assumptions
    )
