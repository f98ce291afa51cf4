# frischid on the command line: docker build -t frischid . && docker run --rm -v "$PWD:/work" frischid demo
FROM python:3.11-slim AS build
COPY . /source
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels /source

FROM python:3.11-slim
COPY --from=build /wheels /wheels
RUN wheel="$(ls /wheels/*.whl)" && pip install --no-cache-dir "${wheel}[fetch,ros]" && frischid doctor
WORKDIR /work
USER 1000
ENTRYPOINT ["frischid"]
CMD ["--help"]
